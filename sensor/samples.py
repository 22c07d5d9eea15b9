"""A dataset in memory: its arrays, the check that they fit together, and selections of samples.

sensor/dataset.py describes the arrays and reads and writes them.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fastac.scenes.schema import Scene
from fastac.scenes.sensor_schema import CHANNELS
from fastac.sensor.optics.mosaic import CELL

SPLITS = ("train", "validation", "test")
FORCE_AXES = ("x", "y", "z")
RAW10_MAXIMUM = 2**10 - 1
PITCH_TOLERANCE = 1e-3
UNIT_TOLERANCE = 1e-4
"""Largest deviation of a normal's squared length from 1; rounding to float32 causes 1e-7."""


class DatasetError(ValueError):
    """A dataset that cannot be used; the message is one line that names file, key and value."""


@dataclass(frozen=True, eq=False)
class Dataset:
    """The content of one dataset file; see sensor/dataset.py. Unknown ground truth is None."""

    pitch_mm: float
    channels: tuple[str, ...]
    source: str
    background: np.ndarray
    split: np.ndarray
    frames: np.ndarray | None = None
    raw10: np.ndarray | None = None
    """(N, 4H, 4W) uint16 RAW10 images instead of `frames`: 4 × 4 raw pixels per pixel of the other arrays."""
    normals: np.ndarray | None = None
    depth_mm: np.ndarray | None = None
    valid: np.ndarray | None = None
    force_n: np.ndarray | None = None
    indenter: dict[str, np.ndarray] | None = None
    rest_depth_mm: np.ndarray | None = None
    force_axes: tuple[str, ...] = FORCE_AXES
    """The axes of `force_n`'s columns: some force gauges measure z only."""
    group: np.ndarray | None = None
    markers_px: np.ndarray | None = None
    tangential_mm: np.ndarray | None = None
    left_out: int = 0
    """How many of the protocol's samples were dropped: the contact could not carry their load, for lack of
    friction or for its shape, or, in a recording, markers were not found."""
    photograph_px: tuple[int, int] | None = None
    """Height and width of the photographs that an importer resampled (sensor/importers/resample.py)."""

    def __len__(self) -> int:
        return len(self.split)

    @property
    def at_rest(self) -> np.ndarray:
        """Which frames equal the background, (N,) bool."""
        return np.array([np.array_equal(frame, self.background) for frame in self.frames])

    def has_force(self, axes: tuple[int, ...]) -> bool:
        """Whether the forces along all of `axes`, 0 to 2 for x to z, were measured."""
        return self.force_n is not None and all(FORCE_AXES[axis] in self.force_axes for axis in axes)

    def forces_n(self, index: np.ndarray, axes: tuple[int, ...]) -> np.ndarray:
        """Forces of the samples `index` along `axes`, float32 (samples, axes).

        Raises DatasetError if an axis was not measured.
        """
        for axis in axes:
            if not self.has_force((axis,)):
                raise DatasetError(f"force_n: {FORCE_AXES[axis]}: not measured")
        return self.force_n[index][:, [self.force_axes.index(FORCE_AXES[axis]) for axis in axes]]

    def indices(self, split: str) -> np.ndarray:
        """Indices of the samples of one split, ascending; empty if the dataset has none."""
        if split not in SPLITS:
            raise DatasetError(f"split = {split!r}: expected one of {', '.join(SPLITS)}")
        return np.flatnonzero(self.split == split)


def _size(data: Dataset, need, origin: str) -> tuple[int, int, int]:
    """Number of samples, and height and width in pixels, from `frames` or, divided by 4, from `raw10`."""
    if data.frames is None and data.raw10 is None:
        raise DatasetError(f"{origin}: frames: missing")
    need(data.frames is None or data.raw10 is None, "raw10", "beside frames", "one of the two")
    if data.raw10 is None:
        need(data.frames.ndim == 4 and len(data.frames), "frames", data.frames.shape, "shape (N, H, W, C)")
        return data.frames.shape[:3]
    shape = data.raw10.shape
    cells = len(shape) == 3 and all(shape) and not shape[1] % CELL and not shape[2] % CELL
    need(cells, "raw10", shape, f"shape (N, H, W), H and W multiples of {CELL}")
    for key in ("raw10", "background"):
        brightest = int(getattr(data, key).max())
        need(brightest <= RAW10_MAXIMUM, key, brightest, f"10-bit values up to {RAW10_MAXIMUM}")
    return shape[0], shape[1] // CELL, shape[2] // CELL


def check(data: Dataset, scene: Scene | None, origin: str) -> None:
    """Raise DatasetError unless shapes, types and values fit together and, if given, the scene.

    origin : the file's name, which begins the message
    """

    def need(condition, key, value, expected):
        if not condition:
            raise DatasetError(f"{origin}: {key} = {value}: expected {expected}")

    need(np.isfinite(data.pitch_mm) and data.pitch_mm > 0, "pitch_mm", data.pitch_mm, "a positive length")
    need(data.channels in CHANNELS.values(), "channels", ",".join(data.channels), "B,G,R or B,G,R,NIR")
    n, height, width = _size(data, need, origin)
    ordered = tuple(axis for axis in FORCE_AXES if axis in data.force_axes)
    need(
        data.force_axes == ordered and ordered,
        "force_axes",
        repr(",".join(data.force_axes)),
        "some of x, y, z, in this order",
    )
    image = (height, width, len(data.channels))
    shapes = {
        "frames": (n, *image),
        "raw10": (n, CELL * height, CELL * width),
        "background": image if data.raw10 is None else (CELL * height, CELL * width),
        "split": (n,),
        "normals": (n, height, width, 3),
        "depth_mm": (n, height, width),
        "valid": (n, height, width),
        "force_n": (n, len(data.force_axes)),
        "group": (n,),
        "rest_depth_mm": (height, width),
        "markers_px": (n, *(() if data.markers_px is None else data.markers_px.shape[1:2]), 2),
        "tangential_mm": (n, height, width, 2),
    }
    for key, shape in shapes.items():
        array = getattr(data, key)
        if array is not None:
            need(array.shape == shape, key, array.shape, f"shape {shape}")
    for name in np.unique(data.split):
        need(name in SPLITS, "split", repr(str(name)), f"one of {', '.join(SPLITS)}")
    need(data.group is None or (data.group != "").all(), "group", "''", "a name")
    for key, array in (data.indenter or {}).items():
        need(array.ndim and len(array) == n, f"indenter/{key}", array.shape, f"{n} entries")
        need(not np.isinf(array).any(), f"indenter/{key}", "infinite", "numbers, or NaN for no indenter")
    for key in ("force_n", "rest_depth_mm", "markers_px", "tangential_mm"):
        array = getattr(data, key)
        need(array is None or np.isfinite(array).all(), key, "NaN or infinite", "finite values")
    for i in range(n):
        where = slice(None) if data.valid is None else data.valid[i]
        if data.depth_mm is not None:
            good = np.isfinite(data.depth_mm[i][where]).all()
            need(good, f"depth_mm[{i}]", "NaN or infinite", "finite values where valid")
        if data.normals is not None:
            normals = data.normals[i][where]
            length2 = np.einsum("...i,...i->...", normals, normals)
            good = np.isfinite(length2).all()
            need(good, f"normals[{i}]", "NaN or infinite", "finite values where valid")
            worst = length2.flat[np.abs(length2 - 1).argmax()] if length2.size else 1.0
            good = abs(worst - 1) <= UNIT_TOLERANCE
            need(good, f"normals[{i}]", f"a vector of length {worst**0.5:.6g}", "unit vectors where valid")
            lowest = normals[..., 2].min(initial=1.0)
            need(lowest > 0, f"normals[{i}]", f"n_z {lowest:.6g}", "n_z > 0 where valid")
    if scene is not None:
        sensor = scene.sensor

        def fits(good: bool, key: str, have: str, want: str) -> None:
            if not good:
                need(good, key, have, f"{want} ({scene.name})")

        want, have = ",".join(sensor.channel_names), ",".join(data.channels)
        fits(have == want, "channels", have, want)
        size, want = f"{height} x {width} px", f"{sensor.height_px} x {sensor.width_px} px"
        fits(size == want, "frames", size, want)
        have = "channels" if data.raw10 is None else "raw10"
        fits(have == sensor.frames, "frames", have, f"{sensor.frames}")
        close = abs(data.pitch_mm / sensor.pitch_mm - 1) <= PITCH_TOLERANCE
        fits(close, "pitch_mm", f"{data.pitch_mm:.6g}", f"{sensor.pitch_mm:g}")


def split_indices(data: Dataset, split: str, path: Path) -> np.ndarray:
    """Indices of the samples of a split, or of all samples for "all".

    Raises DatasetError, naming the file `path`, where there are none.
    """
    index = np.arange(len(data)) if split == "all" else data.indices(split)
    if not len(index):
        raise DatasetError(f"{path}: split: no frame is in {split!r}")
    return index


def evenly_spaced(index: np.ndarray, count: int) -> np.ndarray:
    """`count` entries spread evenly over `index` (all of them if there are fewer)."""
    return index[np.unique(np.linspace(0, len(index) - 1, count).round().astype(int))]


def subset(data: Dataset, index: np.ndarray) -> Dataset:
    """The dataset reduced to the samples `index`."""
    geometry = ("normals", "depth_mm", "valid", "markers_px", "tangential_mm")
    arrays = ("frames", "split", *geometry, "force_n", "group")
    chosen = {name: getattr(data, name)[index] for name in arrays if getattr(data, name) is not None}
    indenter = data.indenter and {name: values[index] for name, values in data.indenter.items()}
    return replace(data, indenter=indenter, **chosen)
