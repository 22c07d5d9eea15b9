// The two LZ4 functions that Verilator's FST writer calls, so that waveforms need no system library.
// Block format: https://github.com/lz4/lz4/blob/dev/doc/lz4_Block_format.md
#pragma once

#include <cstdint>
#include <cstring>
#include <vector>

inline int LZ4_compressBound(int size) { return size + size / 255 + 16; }

// Greedy matching with the latest position of the same four bytes. Returns the compressed size, or 0 if
// `capacity` is below LZ4_compressBound(size).
inline int LZ4_compress_default(const char* source, char* target, int size, int capacity) {
    if (capacity < LZ4_compressBound(size)) return 0;
    constexpr int SHORTEST = 4, FARTHEST = 65535, HASH_BITS = 12;
    constexpr int LAST_LITERALS = 5, LAST_START = 12;  // before the end of the block
    const auto* in = reinterpret_cast<const uint8_t*>(source);
    auto* out = reinterpret_cast<uint8_t*>(target);
    const auto extend = [&out](int rest) {
        for (; rest >= 255; rest -= 255) *out++ = 255;
        *out++ = static_cast<uint8_t>(rest);
    };
    const auto literals = [&](int from, int count, int match) {
        *out++ = static_cast<uint8_t>((count < 15 ? count : 15) << 4 | (match < 15 ? match : 15));
        if (count >= 15) extend(count - 15);
        if (count) std::memcpy(out, in + from, count);
        out += count;
    };
    std::vector<int> latest(1 << HASH_BITS, -1);
    int done = 0, at = 0;
    while (at <= size - LAST_START) {
        uint32_t word, other = 0;
        std::memcpy(&word, in + at, sizeof word);
        int& slot = latest[word * 2654435761U >> (32 - HASH_BITS)];
        const int candidate = slot;
        slot = at;
        if (candidate >= 0) std::memcpy(&other, in + candidate, sizeof other);
        if (candidate < 0 || other != word || at - candidate > FARTHEST) {
            ++at;
            continue;
        }
        int length = SHORTEST;
        while (at + length < size - LAST_LITERALS && in[candidate + length] == in[at + length]) ++length;
        literals(done, at - done, length - SHORTEST);
        *out++ = static_cast<uint8_t>(at - candidate);
        *out++ = static_cast<uint8_t>((at - candidate) >> 8);
        if (length - SHORTEST >= 15) extend(length - SHORTEST - 15);
        done = at += length;
    }
    literals(done, size - done, 0);
    return static_cast<int>(reinterpret_cast<char*>(out) - target);
}
