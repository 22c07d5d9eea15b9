"""What views draw of a record: colours of normals and of the press, the skin as a surface, the force's arrow.

x is the column u, y the row v, z the skin's height, all in mm; x = y = 0 at the image's centre.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from fastac.models.integer.bundle import Bundle
from fastac.streaming.about import About
from fastac.streaming.record import StreamRecord

SURFACE_PX = 64
"""Most vertices along each side of the surface that is drawn."""
RAMP = np.array(
    [
        *((226, 221, 208), (190, 219, 190), (128, 199, 186), (70, 165, 190)),
        *((38, 118, 178), (42, 68, 146), (28, 32, 88)),
    ]
)
"""Red, green, blue of presses from none, the colour of the skin at rest, to the deepest."""
LEAST_PRESS_MM, LEAST_FORCE_N = 0.05, 0.05
"""The full scales of presses and forces to begin with, so that noise is not shown as a contact."""
ARROW_SHARE = 0.35
"""Length of the arrow of the largest force so far, as a share of the image's width."""
TOUCHED_SHARE = 0.5
"""Pixels pressed by more than this share of the deepest press are where the arrow ends."""


def rest_depth_mm(bundle: Bundle) -> np.ndarray:
    """(H - 2, W - 2) float32: height z of the skin at rest, as the bundle's depth finds it; mm."""
    pipeline = bundle.pipeline
    if pipeline.depth is None:
        return pipeline.rest_depth_mm[1:-1, 1:-1].astype(np.float32)
    return (pipeline.depth.rest * pipeline.depth_mm_per_unit).astype(np.float32)


def thinned(image: np.ndarray, most: int) -> np.ndarray:
    """Every n-th row and column of an image (rows, columns, …): at most `most` of either."""
    step = _step(image, most)
    return image[::step, ::step]


def _step(image: np.ndarray, most: int) -> int:
    return -(-max(image.shape[:2]) // most)


def colours_of_normals(normals: np.ndarray) -> np.ndarray:
    """(…, 3) unit vectors to uint8: x, y, z of -1 to 1 as red, green, blue of 0 to 255."""
    return np.clip(np.rint(127.5 * (normals + 1)), 0, 255).astype(np.uint8)


def colours_of_press(press_mm: np.ndarray, full_mm: float) -> np.ndarray:
    """Presses in mm to (…, 3) uint8 by RAMP, whose end stands for `full_mm`."""
    place = np.clip(press_mm / full_mm, 0, 1)
    return _TABLE[np.rint(place * (len(_TABLE) - 1)).astype(np.uint8)]


_TABLE = np.stack(
    [np.interp(np.linspace(0, len(RAMP) - 1, 256), range(len(RAMP)), band) for band in RAMP.T], axis=1
).astype(np.uint8)


@dataclass(frozen=True)
class Arrow:
    """The force on the skin: `vector_mm` ends at `tip_mm`, both (3,) mm.

    The vector's z is negative in compression: it points into the skin.
    """

    tip_mm: np.ndarray
    vector_mm: np.ndarray


@dataclass
class Sight:
    """What a view knows of a sensor beside its records, and the scales of what it has seen.

    rest_depth_mm : (H - 2, W - 2), as `rest_depth_mm`
    full_press_mm, full_force_n, full_shear_n : the largest press, force, and force along the skin so far
    """

    about: About
    rest_depth_mm: np.ndarray
    full_press_mm: float = LEAST_PRESS_MM
    full_force_n: float = LEAST_FORCE_N
    full_shear_n: float = LEAST_FORCE_N
    x_mm: np.ndarray = field(init=False, repr=False)
    y_mm: np.ndarray = field(init=False, repr=False)

    def __post_init__(self):
        rows, columns = self.rest_depth_mm.shape
        pitch = self.about.pitch_mm
        self.x_mm = ((np.arange(columns) - (columns - 1) / 2) * pitch).astype(np.float32)
        self.y_mm = ((np.arange(rows) - (rows - 1) / 2) * pitch).astype(np.float32)

    def grid_mm(self) -> tuple[np.ndarray, np.ndarray]:
        """x and y of the columns and rows of the surface that is drawn."""
        step = _step(self.rest_depth_mm, SURFACE_PX)
        return self.x_mm[::step], self.y_mm[::step]

    @property
    def live(self) -> bool:
        """Whether time stamps are a camera's, ns since 1970, and not those of a recording, from 0."""
        return self.about.frames_per_second is None

    def press_mm(self, record: StreamRecord) -> np.ndarray | None:
        """(H - 2, W - 2): how far below its rest the skin is; None without depth."""
        return None if record.depth_mm is None else self.rest_depth_mm - record.depth_mm

    def see(self, record: StreamRecord, press_mm: np.ndarray | None) -> None:
        """Let the scales grow to this record's press and force."""
        if press_mm is not None:
            self.full_press_mm = max(self.full_press_mm, float(press_mm.max()))
        if record.force_n:
            x, y, z = (record.force_n.get(axis, 0.0) for axis in "xyz")
            self.full_force_n = max(self.full_force_n, math.hypot(x, y, z))
            self.full_shear_n = max(self.full_shear_n, math.hypot(x, y))

    def arrow(self, record: StreamRecord, press_mm: np.ndarray | None) -> Arrow | None:
        """The force, as long as its share of `full_force_n`; None where the record has none.

        It ends in the middle of what is pressed deepest; without depth at the centre of the skin at rest.
        """
        if not record.force_n:
            return None
        force = np.array([record.force_n.get(axis, 0.0) for axis in "xyz"])
        surface = self.rest_depth_mm if record.depth_mm is None else record.depth_mm
        row, column = (n // 2 for n in surface.shape)
        if press_mm is not None and (deepest := press_mm.max()) > 0:
            weight = np.maximum(press_mm - TOUCHED_SHARE * deepest, 0)
            row = round(float(weight.sum(1) @ np.arange(weight.shape[0]) / weight.sum()))
            column = round(float(weight.sum(0) @ np.arange(weight.shape[1]) / weight.sum()))
        tip = np.array([self.x_mm[column], self.y_mm[row], surface[row, column]])
        mm_per_n = ARROW_SHARE * self.about.width_px * self.about.pitch_mm / self.full_force_n
        return Arrow(tip, mm_per_n * force * (1, 1, -1))


def triangles(rows: int, columns: int) -> np.ndarray:
    """(2 (rows - 1) (columns - 1), 3) uint32: vertices of a grid's triangles, anticlockwise seen from +z."""
    at = np.arange(rows * columns, dtype=np.uint32).reshape(rows, columns)
    corners = at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]
    a, b, c, d = (corner.ravel() for corner in corners)
    return np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def surface_normals(depth_mm: np.ndarray, step_mm: float) -> np.ndarray:
    """(rows, columns, 3) float32: unit normals of a height map whose samples are `step_mm` apart."""
    q, p = np.gradient(depth_mm, step_mm)
    normals = np.stack([-p, -q, np.ones_like(p)], axis=-1)
    return (normals / np.linalg.norm(normals, axis=-1, keepdims=True)).astype(np.float32)
