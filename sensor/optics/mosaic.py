"""The 4 × 4 RGB-IR colour filter array of OmniVision's sensors, and what it makes of a four-channel image.

    B G R G
    G I G I
    R G B G
    G I G I

NIR lies at odd rows and odd columns and what is rearranged is a BGGR Bayer cell: the two facts that the paper
states of its OV2736 ("Spectral Demultiplexing and Pre-processing"). With green on one half of the pixels they
leave this layout, up to a swap of the B, R pairs.
"""

import numpy as np

CHANNELS = ("B", "G", "R", "NIR")
CELL = 4
"""Rows and columns of the pattern."""
LAYOUT = np.array([[0, 1, 2, 1], [1, 3, 1, 3], [2, 1, 0, 1], [1, 3, 1, 3]])
"""Index into CHANNELS of each phase (v mod 4, u mod 4)."""


class MosaicError(ValueError):
    """An image that cannot be what it is given as; the message is one line with what was expected."""


def check_cells(height_px: int, width_px: int, what: str) -> None:
    """Raise MosaicError unless an image consists of whole cells of the pattern."""
    for key, size in (("height", height_px), ("width", width_px)):
        if size < CELL or size % CELL:
            raise MosaicError(
                f"{what}: {key} = {size} px: expected a multiple of {CELL}, the filter array's cell"
            )


def window(
    height_px: int, width_px: int, kept_px: tuple[int, int], *, multiple_of: int = CELL
) -> tuple[slice, slice]:
    """Rows and columns of the middle `kept_px` (height, width) of an image, beginning with a whole cell.

    Raises MosaicError where that is larger than the image or no multiple of the cell and of `multiple_of`.
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
    """What reaches each pixel through its filter: (…, H, W, 4) in B, G, R, NIR to (…, H, W), float64.

    A visible pixel also sees `crosstalk` (of B, G, R) times the NIR light at its place. Raises MosaicError on
    another number of channels or a size that is no whole number of cells.
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
