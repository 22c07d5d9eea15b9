"""A frame and what was found in it, as images with their units and colours."""

import base64
import io
from dataclasses import dataclass

import matplotlib
import numpy as np
from PIL import Image

from fastac.models.result import Result
from fastac.scenes.schema import AXES, Scene
from fastac.sensor.dataset import Dataset

SHADES = 9
"""Colours from which a page draws the gradient of a colour bar."""


@dataclass(frozen=True, eq=False)
class Panel:
    """An image: colours (H, W, 3) uint8, or values (H, W) in `unit` with the name of Matplotlib's colour map.

    signed : the colours' middle is zero
    """

    title: str
    image: np.ndarray
    unit: str = ""
    colours: str = ""
    signed: bool = False
    low: float | None = None
    high: float | None = None

    @property
    def ends(self) -> tuple[float, float]:
        """The values of the first and the last colour."""
        if self.signed:
            most = max(float(np.abs(self.image).max()), np.finfo(np.float32).tiny)
            return -most, most
        low = float(self.image.min()) if self.low is None else self.low
        return low, float(self.image.max()) if self.high is None else self.high

    @property
    def pixels(self) -> np.ndarray:
        """The colours that are shown, (H, W, 3) uint8."""
        if not self.colours:
            return self.image
        low, high = self.ends
        share = (self.image - low) / (high - low if high > low else 1)
        return matplotlib.colormaps[self.colours](share, bytes=True)[..., :3]

    @property
    def base64_png(self) -> str:
        buffer = io.BytesIO()
        Image.fromarray(np.ascontiguousarray(self.pixels)).save(buffer, format="png", optimize=True)
        return base64.b64encode(buffer.getvalue()).decode()

    @property
    def shades(self) -> list[str]:
        """The colour bar's colours from low to high, as hexadecimal."""
        return shades(self.colours, SHADES)


def shades(colours: str, count: int) -> list[str]:
    """`count` evenly spaced colours of one of Matplotlib's colour maps, as hexadecimal."""
    chosen = matplotlib.colormaps[colours](np.linspace(0, 1, count))
    return [matplotlib.colors.to_hex(colour) for colour in chosen]


def rgb(frame: np.ndarray) -> np.ndarray:
    """A frame (H, W, 3 or 4) in B, G, R[, NIR] as an RGB picture (H, W, 3)."""
    return frame[..., 2::-1]


def panels(data: Dataset, sample: int, found: Result, scene: Scene, k: int = 0) -> list[Panel]:
    """The panels of the frame `sample` of a dataset, which is the frame `k` of the results in `found`.

    A network that has learned from forces may find none that are the skin's; then there are none.
    """
    frame = data.frames[sample]
    shown = [Panel("input (RGB)", rgb(frame))]
    if frame.shape[-1] == 4:
        shown.append(Panel("NIR", frame[..., 3], colours="gray", low=0, high=255))
    if scene.finds_normals:
        normals = np.clip((found.normals[k] + 1) / 2, 0, 1)
        shown.append(Panel("normals", (255 * normals).round().astype(np.uint8)))
    if found.depth_mm is not None:
        shown.append(Panel("depth", found.depth_mm[k], "mm", "viridis"))
        shown.append(Panel("displacement", found.displacement_mm[k], "mm", "magma"))
    return shown


def more_panels(data: Dataset, sample: int, found: Result, scene: Scene, k: int = 0) -> list[Panel]:
    """What else there is to see of that frame: its depth error where the truth is known, its force maps."""
    shown = []
    if found.depth_mm is not None and data.depth_mm is not None:
        error = found.depth_mm[k] - data.depth_mm[sample]
        known = np.isfinite(error) if data.valid is None else data.valid[sample]
        shown.append(Panel("depth error", np.where(known, error, 0), "mm", "coolwarm", signed=True))
    if found.force_map_n is not None:
        for axis, image in zip(scene.force_axes, found.force_map_n[k], strict=True):
            shown.append(Panel(f"F_{AXES[axis]} map", image, "N", "coolwarm", signed=True))
    return shown
