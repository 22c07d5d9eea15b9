"""Compiled loops over the pixels of one frame: what `integer.FrameValidity.of_pixels` measures, rows by
rows."""

from numba import int32

from fastac.store.compiled_loops import compiled

_compiled = compiled()

CLIPPED, CHANGE, DETAIL, BRIGHTNESS = 0, 1, 2, 3
"""Where each measure is; brightness has a place for each channel, the last ones."""


def _row_of(channels: int):
    """The loop over a row of pixels with so many channels: known beforehand, they let the compiler use
    vectors, as sums of 32 bits do."""

    @_compiled
    def measure_row(row, known, before, sums):
        change = detail = clipped = int32(0)
        for p in range(len(row)):
            change = int32(change + abs(int32(int32(row[p]) - int32(known[p]))))
        for p in range(len(before)):
            detail = int32(detail + abs(int32(int32(row[channels + p]) - int32(before[p]))))
        for p in range(len(row) // channels):
            beyond = False
            for c in range(channels):
                value = row[p * channels + c]
                beyond |= (value == 0) | (value == 255)
            clipped = int32(clipped + beyond)
        for c in range(channels):
            total = int32(0)
            for p in range(len(row) // channels):
                total = int32(total + int32(int32(row[p * channels + c]) - int32(known[p * channels + c])))
            sums[BRIGHTNESS + c] += total
        sums[CLIPPED] += clipped
        sums[CHANGE] += change
        sums[DETAIL] += detail

    return measure_row


_row_of_three, _row_of_four = _row_of(3), _row_of(4)


@_compiled
def measure(frame, background, width, channels, first, rows, sums):
    """Write the measures of some whole rows into `sums` (BRIGHTNESS + channels,) int64.

    frame, background : (pixels · channels) uint8, the channels of a pixel, 3 or 4, side by side
    """
    for k in range(len(sums)):
        sums[k] = 0
    size = width * channels
    for start in range(first * size, (first + rows) * size, size):
        row, known = frame[start : start + size], background[start : start + size]
        before = row[: size - channels]
        if channels == 3:
            _row_of_three(row, known, before, sums)
        else:
            _row_of_four(row, known, before, sums)
