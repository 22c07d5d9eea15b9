"""Packing and unpacking of MIPI CSI-2 RAW10 images: four 10-bit pixels in five bytes.

Bytes 0 to 3 hold bits 9 to 2 of pixels 0 to 3; byte 4 holds their bits 1 and 0, pixel 0 in the lowest two
(MIPI CSI-2, RAW10; the Linux kernel's V4L2_PIX_FMT_SBGGR10P). models/vision/image_processing.py makes the
channels B, G, R, NIR of such images.
"""

import numpy as np

MAXIMUM = 2**10 - 1
"""The largest RAW10 value, I_max in the paper."""
PIXELS, BYTES = 4, 5
"""Pixels in a group, and bytes of a packed group."""
_SHIFTS = np.arange(0, 2 * PIXELS, 2, dtype=np.uint8)


class Raw10Error(ValueError):
    """Data that are not a RAW10 image; the message is one line with what was expected."""


def _check_width(width_px: int) -> None:
    if width_px < PIXELS or width_px % PIXELS:
        raise Raw10Error(f"RAW10: width = {width_px} px: expected a multiple of {PIXELS}")


def pack(raw: np.ndarray) -> np.ndarray:
    """Pack pixels (…, H, W) uint16, at most 1023, into bytes (…, H, 5 W / 4) uint8.

    Raises Raw10Error on another type, a larger value or a width that is not a multiple of four.
    """
    if raw.dtype != np.uint16:
        raise Raw10Error(f"RAW10: pixels are {raw.dtype}: expected uint16")
    _check_width(raw.shape[-1])
    if raw.size and raw.max() > MAXIMUM:
        raise Raw10Error(f"RAW10: a pixel is {raw.max()}: expected at most {MAXIMUM}")
    groups = raw.reshape(*raw.shape[:-1], -1, PIXELS)
    packed = np.empty((*groups.shape[:-1], BYTES), np.uint8)
    packed[..., :PIXELS] = groups >> 2
    packed[..., PIXELS] = np.bitwise_or.reduce((groups & 3).astype(np.uint8) << _SHIFTS, axis=-1)
    return packed.reshape(*raw.shape[:-1], -1)


def unpack(data: bytes | np.ndarray, height_px: int, width_px: int) -> np.ndarray:
    """Unpack one image, bytes or uint8 of any shape, into pixels (H, W) uint16.

    Raises Raw10Error on another type or length than that of one image.
    """
    _check_width(width_px)
    if isinstance(data, np.ndarray) and data.dtype != np.uint8:
        raise Raw10Error(f"RAW10: data are {data.dtype}: expected uint8")
    packed = (
        np.ascontiguousarray(data).ravel() if isinstance(data, np.ndarray) else np.frombuffer(data, np.uint8)
    )
    expected = height_px * width_px // PIXELS * BYTES
    if packed.size != expected:
        kind = "truncated" if packed.size < expected else "too long"
        raise Raw10Error(
            f"RAW10: {packed.size} bytes: {kind}, expected {expected} for {width_px} x {height_px} px"
        )
    groups = packed.reshape(-1, BYTES)
    raw = groups[:, :PIXELS].astype(np.uint16) << 2
    raw |= groups[:, PIXELS:] >> _SHIFTS & 3
    return raw.reshape(height_px, width_px)
