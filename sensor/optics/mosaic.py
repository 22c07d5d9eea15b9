"""The 4 × 4 RGB-IR colour filter array of OmniVision's image sensors, and the mosaic of a four-channel image.

    B G R G
    G I G I
    R G B G
    G I G I

The paper states of its OV2736 that NIR pixels are at odd rows and odd columns, and that the rearranged mosaic
is a BGGR Bayer pattern ("Spectral Demultiplexing and Pre-processing"). With green at half of the pixels, only
this layout and the one with B and R swapped satisfy both.
"""

import numpy as np

CHANNELS = ("B", "G", "R", "NIR")
CELL = 4
"""Rows and columns of the pattern's unit cell."""
LAYOUT = np.array([[0, 1, 2, 1], [1, 3, 1, 3], [2, 1, 0, 1], [1, 3, 1, 3]])
"""Index into CHANNELS of the filter at (v mod 4, u mod 4)."""


class MosaicError(ValueError):
    """An image or parameter that does not fit the filter array; the message is one line with what was
    expected."""


def check_cells(height_px: int, width_px: int, what: str) -> None:
    """Raise MosaicError, beginning with `what`, unless an image consists of whole cells of the pattern."""
    for key, size in (("height", height_px), ("width", width_px)):
        if size < CELL or size % CELL:
            raise MosaicError(
                f"{what}: {key} = {size} px: expected a multiple of {CELL}, the filter array's cell"
            )


def window(
    height_px: int, width_px: int, kept_px: tuple[int, int], *, multiple_of: int = CELL
) -> tuple[slice, slice]:
    """Slices of rows and columns of the central window `kept_px` (height, width), aligned to whole cells.

    Raises MosaicError where the window is larger than the image or not a multiple of the cell and of
    `multiple_of`.
    """
    slices = []
    for key, size, kept in zip(("height", "width"), (height_px, width_px), kept_px, strict=True):
        if not 0 < kept <= size or kept % multiple_of or kept % CELL:
            raise MosaicError(
                f"crop_px {key} = {kept}: expected at most {size} and a multiple of {CELL}"
                f" and of downsample = {multiple_of}"
            )
        start = (size - kept) // 2 // CELL * CELL
        slices.append(slice(start, start + kept))
    return slices[0], slices[1]


def mosaic(channels: np.ndarray, crosstalk: tuple[float, float, float]) -> np.ndarray:
    """The mosaic that the filter array passes: (…, H, W, 4) in B, G, R, NIR to (…, H, W), float64.

    A B, G or R pixel also receives its `crosstalk` times the NIR light at its position. Raises MosaicError on
    another number of channels or a size that is not a whole number of cells.
    """
    if channels.ndim < 3 or channels.shape[-1] != len(CHANNELS):
        raise MosaicError(f"channels: shape = {channels.shape}: expected (…, height, width, 4)")
    height, width = channels.shape[-3:-1]
    check_cells(height, width, "channels")
    leak = (*crosstalk, 0.0)
    image = np.empty(channels.shape[:-1])
    for (v, u), channel in np.ndenumerate(LAYOUT):
        seen = channels[..., v::CELL, u::CELL, :]
        image[..., v::CELL, u::CELL] = seen[..., channel] + leak[channel] * seen[..., 3]
    return image
