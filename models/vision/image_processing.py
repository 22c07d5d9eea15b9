"""Image processing from RAW10 to the channels B, G, R, NIR: the paper's demosaicing, or binning of 4 × 4
cells.

The paper's steps (Lu et al., "FasTac", "Spectral Demultiplexing and Pre-processing") are dead-pixel
correction, black-level subtraction, NIR sampled at odd rows and columns and interpolated, infrared
subtraction

    Ĩ = clip(I_blc − α · min(I_NIR, I_max / β), 0, I_max),

rearrangement to a BGGR Bayer mosaic, demosaicing, 8-bit NIR, crop and downsampling. The paper gives neither α
and β nor the filters of the steps; each function names the one that it uses. Binning instead takes, after the
same first two steps, the mean of each colour in a 4 × 4 cell: a quarter of the resolution in one pass. The
centres of a cell's colours are up to one raw pixel apart along each axis; binning does not correct this.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.optics.mosaic import CELL, CHANNELS, LAYOUT, MosaicError, check_cells, window
from fastac.sensor.optics.raw10 import MAXIMUM

SAME_FILTER = np.zeros((9, 9), np.uint8)
"""Mask of the eight nearest pixels that have the centre's colour filter wherever in the pattern the centre
is: (±2, ±2), (0, ±4) and (±4, 0)."""
for _v, _u in ((2, 2), (2, 6), (6, 2), (6, 6), (0, 4), (8, 4), (4, 0), (4, 8)):
    SAME_FILTER[_v, _u] = 1
DEMOSAIC_SCALE = 64
"""Factor from RAW10 values to the 16-bit integers of OpenCV's demosaicing: six fractional bits."""


class ImageProcessingError(ValueError):
    """An image or a setting that cannot be processed; the message is one line with what was expected."""


@dataclass(frozen=True)
class ImageProcessing:
    """Settings of demosaicing and binning; levels are in RAW10 digital numbers (DN)."""

    black_level_dn: float = 64.0
    alpha: float = 0.8
    """Strength of the infrared subtraction: NIR response of a visible pixel relative to an NIR pixel."""
    beta: float = 1.0
    """Limit of the infrared subtraction: NIR values above I_max / β are clipped to it."""
    dead_pixel_dn: float = 128.0
    """A pixel counts as dead where it is outside the range of its eight SAME_FILTER neighbours by more than
    this."""
    crop_px: tuple[int, int] | None = None
    """Height and width of the central window that is kept, aligned to whole cells; None keeps the image."""
    downsample: int = 4
    """Raw pixels along each axis per output pixel; binning requires a multiple of four."""

    def __post_init__(self):
        for key, low, high in (("black_level_dn", 0, MAXIMUM), ("alpha", 0, 4), ("beta", 1, MAXIMUM)):
            if not low <= getattr(self, key) <= high:
                raise ImageProcessingError(f"{key} = {getattr(self, key):g}: expected {low} to {high}")
        if not self.dead_pixel_dn > 0:
            raise ImageProcessingError(f"dead_pixel_dn = {self.dead_pixel_dn:g}: expected more than 0")
        if self.downsample < 1:
            raise ImageProcessingError(f"downsample = {self.downsample}: expected at least 1")

    def demosaic(self, raw: np.ndarray) -> np.ndarray:
        """The paper's path: RAW10 (H, W) uint16 to frames (h, w, 4) uint8 in B, G, R, NIR."""
        level = self.levels(raw)
        nir = interpolate_nir(level)
        bayer = to_bggr(self.subtract_nir(level, nir))
        colours = cv2.demosaicing(np.rint(bayer * DEMOSAIC_SCALE).astype(np.uint16), cv2.COLOR_BayerBGGR2BGR)
        channels = np.dstack([colours * np.float32(1 / DEMOSAIC_SCALE), nir])
        rows, columns = self.window(*raw.shape)
        return to_8_bits(downsample(channels[rows, columns], self.downsample))

    def bin_cells(self, raw: np.ndarray) -> np.ndarray:
        """Direct binning: RAW10 (H, W) uint16 to frames (h, w, 4) uint8 in B, G, R, NIR."""
        if self.downsample % CELL:
            raise ImageProcessingError(
                f"downsample = {self.downsample}: binning expects a multiple of {CELL}"
            )
        level = self.levels(raw)
        rows, columns = self.window(*raw.shape)
        cells = cell_means(level[rows, columns])
        cells[..., :3] = self.subtract_nir(cells[..., :3], cells[..., 3:])
        return to_8_bits(downsample(cells, self.downsample // CELL))

    def levels(self, raw: np.ndarray) -> np.ndarray:
        """Dead-pixel correction and black level: (H, W) uint16 to float32, negative where noise is."""
        check_raw(raw)
        return correct_dead_pixels(raw, self.dead_pixel_dn).astype(np.float32) - np.float32(
            self.black_level_dn
        )

    def subtract_nir(self, visible: np.ndarray, nir: np.ndarray) -> np.ndarray:
        """The paper's infrared subtraction (see the module), for arrays that broadcast."""
        estimate = np.minimum(nir, np.float32(MAXIMUM / self.beta))
        return np.clip(visible - np.float32(self.alpha) * estimate, 0, MAXIMUM)

    def window(self, height_px: int, width_px: int) -> tuple[slice, slice]:
        """Slices of the rows and columns that are kept: the central window, aligned to whole cells."""
        size = height_px, width_px
        try:
            return window(*size, self.crop_px or size, multiple_of=self.downsample)
        except MosaicError as error:
            raise ImageProcessingError(str(error)) from None


def check_raw(raw: np.ndarray) -> None:
    """Raise ImageProcessingError unless `raw` is (H, W) uint16 of at most 1023 and two cells; MosaicError
    unless it consists of whole cells."""
    if raw.dtype != np.uint16 or raw.ndim != 2:
        raise ImageProcessingError(f"RAW image: {raw.dtype} {raw.shape}: expected uint16 (height, width)")
    check_cells(*raw.shape, "RAW image")
    if min(raw.shape) < 2 * CELL:
        raise ImageProcessingError(
            f"RAW image: {raw.shape[0]} x {raw.shape[1]} px: expected at least {2 * CELL}"
        )
    if raw.max() > MAXIMUM:
        raise ImageProcessingError(f"RAW image: a pixel is {raw.max()}: expected at most {MAXIMUM}")


def correct_dead_pixels(raw: np.ndarray, threshold_dn: float) -> np.ndarray:
    """Replace dead and hot pixels of (H, W) uint16 by the median of their SAME_FILTER neighbours.

    A pixel counts as dead where it is outside the range of these eight neighbours by more than the threshold.
    At the edges the mosaic is padded by the pixels two cells inwards, never by the pixel itself.
    """
    padded = pad_periodically(raw, CELL, 2 * CELL)
    inside = slice(CELL, -CELL), slice(CELL, -CELL)
    highest = cv2.dilate(padded, SAME_FILTER)[inside].astype(np.float32)
    lowest = cv2.erode(padded, SAME_FILTER)[inside].astype(np.float32)
    rows, columns = np.nonzero((raw > highest + threshold_dn) | (raw < lowest - threshold_dn))
    offsets = np.argwhere(SAME_FILTER)
    neighbours = padded[rows[:, None] + offsets[:, 0], columns[:, None] + offsets[:, 1]]
    corrected = raw.copy()
    corrected[rows, columns] = np.rint(np.median(neighbours, axis=1))
    return corrected


def pad_periodically(mosaic: np.ndarray, margin: int, period: int) -> np.ndarray:
    """Pad a mosaic (H, W) by `margin` on each side with the pixels one period inwards, which keeps the colour
    filters' pattern."""
    indices = []
    for size in mosaic.shape:
        index = np.arange(-margin, size + margin)
        index[:margin] += period
        index[-margin:] -= period
        indices.append(index)
    return mosaic[indices[0]][:, indices[1]]


def interpolate_nir(level: np.ndarray) -> np.ndarray:
    """NIR at every pixel, (H, W) float32: samples at (2m + 1, 2n + 1), bilinear interpolation between them.

    Row 0 and column 0, outside the samples, repeat row 1 and column 1.
    """
    return _between(_between(level[1::2, 1::2]).T).T


def _between(samples: np.ndarray) -> np.ndarray:
    """Interpolate rows from the samples at rows 1, 3, 5, …: means of two neighbours; row 0 repeats row 1."""
    dense = np.empty((2 * len(samples), samples.shape[1]), samples.dtype)
    dense[0] = samples[0]
    dense[1::2] = samples
    dense[2::2] = (samples[:-1] + samples[1:]) / 2
    return dense


def to_bggr(visible: np.ndarray) -> np.ndarray:
    """Convert an RGB-IR mosaic (H, W), after infrared subtraction, to a BGGR Bayer mosaic of the same size.

    B at (0, 0) and (2, 2) and all G are kept. NIR pixels become R: the mean of their two diagonal neighbours
    that are R. R pixels become B: the mean of the four nearest B, two pixels away along the axes.
    """
    bayer = visible.copy()
    padded = pad_periodically(visible, 2, CELL)
    height, width = visible.shape

    def shifted(v: int, u: int, dv: int, du: int) -> np.ndarray:
        return padded[2 + v + dv : 2 + height + dv : CELL, 2 + u + du : 2 + width + du : CELL]

    for (v, u), channel in np.ndenumerate(LAYOUT):
        if CHANNELS[channel] == "R":
            near = [shifted(v, u, dv, du) for dv, du in ((-2, 0), (2, 0), (0, -2), (0, 2))]
        elif CHANNELS[channel] == "NIR":
            diagonals = ((-1, -1), (-1, 1), (1, -1), (1, 1))
            near = [
                shifted(v, u, dv, du)
                for dv, du in diagonals
                if CHANNELS[LAYOUT[(v + dv) % CELL, (u + du) % CELL]] == "R"
            ]
        else:
            continue
        bayer[v::CELL, u::CELL] = sum(near) / np.float32(len(near))
    return bayer


def cell_means(level: np.ndarray) -> np.ndarray:
    """The mean of each channel's pixels in each cell, (H, W) to (H / 4, W / 4, 4) in B, G, R, NIR."""
    cells = np.zeros((level.shape[0] // CELL, level.shape[1] // CELL, len(CHANNELS)), level.dtype)
    for (v, u), channel in np.ndenumerate(LAYOUT):
        cells[..., channel] += level[v::CELL, u::CELL]
    return cells / np.bincount(LAYOUT.ravel()).astype(level.dtype)


def downsample(image: np.ndarray, factor: int) -> np.ndarray:
    """The mean of each factor × factor square of (H, W, C) float32."""
    if factor == 1:
        return image
    height, width = image.shape[0] // factor, image.shape[1] // factor
    return cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)


def to_8_bits(image: np.ndarray) -> np.ndarray:
    """Convert RAW10 values to rounded 8-bit ones, with 1023 as 255; values are clipped to the range."""
    return np.rint(np.clip(image, 0, MAXIMUM) * np.float32(255 / MAXIMUM)).astype(np.uint8)


def channels(raw: np.ndarray, sensor: Sensor) -> np.ndarray:
    """Process one RAW10 image (4H, 4W) uint16 into the sensor's channels (H, W, C) uint8."""
    keys = ("black_level_dn", "alpha", "beta", "dead_pixel_dn")
    processing = ImageProcessing(**{key: getattr(sensor.raw10, key) for key in keys})
    by = processing.demosaic if sensor.raw10.method == "demosaic" else processing.bin_cells
    return by(raw)[..., : len(sensor.channel_names)]


def as_channels(image: np.ndarray, sensor: Sensor) -> np.ndarray:
    """The channels (H, W, C) uint8 of a frame: processed if the sensor sends RAW10, otherwise unchanged."""
    return channels(image, sensor) if sensor.frames == "raw10" else image
