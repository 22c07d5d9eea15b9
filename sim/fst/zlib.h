// The two zlib functions that Verilator's FST writer calls, so that waveforms need no system library.
// Blocks are stored without compression (RFC 1950, RFC 1951); the writer then keeps the uncompressed data.
#pragma once

#include <algorithm>
#include <cstring>

using Bytef = unsigned char;
using uLong = unsigned long;
using uLongf = unsigned long;
constexpr int Z_OK = 0, Z_BUF_ERROR = -5;
constexpr uLong STORED_BLOCK = 65535;

inline uLong compressBound(uLong size) { return size + 5 * (size / STORED_BLOCK + 1) + 6; }

inline int compress2(Bytef* target, uLongf* target_size, const Bytef* source, uLong size, int /*level*/) {
    if (*target_size < compressBound(size)) return Z_BUF_ERROR;
    Bytef* out = target;
    *out++ = 0x78;
    *out++ = 0x01;
    uLong at = 0;
    do {
        const uLong length = std::min(size - at, STORED_BLOCK);
        *out++ = at + length == size;
        for (const uLong word : {length, ~length}) {
            *out++ = static_cast<Bytef>(word);
            *out++ = static_cast<Bytef>(word >> 8);
        }
        if (length) std::memcpy(out, source + at, length);
        out += length;
        at += length;
    } while (at < size);
    uLong low = 1, high = 0;
    for (uLong k = 0; k < size; ++k) {
        low = (low + source[k]) % 65521;
        high = (high + low) % 65521;
    }
    for (const uLong word : {high >> 8, high, low >> 8, low}) *out++ = static_cast<Bytef>(word);
    *target_size = out - target;
    return Z_OK;
}
