"""The press protocol: at which positions, and with which loads, balls are pressed on the skin.

It follows the paper's protocol (supplement, section I). A position is that of the ball's axis, in mm from the
image's centre. The grids of the train, validation and test splits share no point. At each position the
vertical loads follow one another; if the scene has tangential loads, each vertical load is followed by
tangential ones in four in-plane directions. Beyond the paper's, further balls and other objects may follow,
one at each position of train and validation; and train and validation may have a few of the loads at each
position, in turn.
"""

import math
from dataclasses import dataclass

import numpy as np

from fastac.scenes.schema import Protocol, Scene
from fastac.scenes.sensor_schema import Sensor

MARGIN_BALLS = 0.3
"""Distance from the fixed rim to the outermost positions, in ball diameters: room for the growing contact."""
DIRECTIONS = ((1, 0), (-1, 0), (0, 1), (0, -1))
"""Directions of the tangential loads, (x, y) each."""


class FingertipError(ValueError):
    """A scene that the virtual fingertip cannot simulate; the message is one line with key and value."""


@dataclass(frozen=True)
class Station:
    """One vertical load at one position, and the tangential loads that follow it."""

    split: str
    x_mm: float
    y_mm: float
    load_n: float
    ball_mm: float
    """Diameter of the ball; NaN for another shape."""
    tangential_n: tuple[tuple[float, float], ...] = ()
    shape: str = "ball"
    """The object's kind: a ball, or an entry of `protocol.more_shapes`."""
    draw: tuple[int, ...] = ()
    """Seed of the object's random size; empty for a ball."""
    group: str = ""
    """The object at its place: stations of one group differ in their loads only."""

    @property
    def targets_n(self) -> tuple[tuple[float, float], ...]:
        """(F_x, F_y) in N at which each sample is taken; the first is (0, 0): the vertical load alone."""
        return ((0.0, 0.0), *self.tangential_n)


def region_mm(sensor: Sensor, protocol: Protocol) -> np.ndarray:
    """The corners of the pressed region, (2, 2, 2) in mm: top/bottom, left/right, and x, y.

    Raises FingertipError for corners outside the skin, or a ball too large for the region inside the rim.
    """
    if protocol.corners_mm is not None:
        corners = np.array(protocol.corners_mm).reshape(2, 2, 2)
        half = np.array([sensor.width_px - 1, sensor.height_px - 1]) * sensor.pitch_mm / 2
        for x, y in corners.reshape(-1, 2):
            if abs(x) > half[0] or abs(y) > half[1]:
                raise FingertipError(
                    f"protocol.corners_mm = {x:g}, {y:g}: expected inside the skin,"
                    f" ±{half[0]:g} by ±{half[1]:g} mm"
                )
        return corners
    margin = sensor.elastomer.rim_mm + MARGIN_BALLS * protocol.ball_mm
    half_x = (sensor.width_px - 1) * sensor.pitch_mm / 2 - margin
    half_y = (sensor.height_px - 1) * sensor.pitch_mm / 2 - margin
    if half_x <= 0 or half_y <= 0:
        raise FingertipError(
            f"protocol.ball_mm = {protocol.ball_mm:g}: no room for it between rims of"
            f" {sensor.elastomer.rim_mm:g} mm on {sensor.width_px} x {sensor.height_px} px"
            f" of {sensor.pitch_mm:g} mm"
        )
    return np.array([[(x * half_x, y * half_y) for x in (-1, 1)] for y in (-1, 1)])


def positions_mm(sensor: Sensor, protocol: Protocol) -> dict[str, np.ndarray]:
    """Positions (n², 2) of the ball's axis, x and y in mm, for each split.

    All three grids are subsets of one lattice of 2m × 2m points, with m the size of the largest grid: train
    takes points with even indices along both axes, test with odd indices along both, validation odd along x
    and even along y. So positions of two splits are at least one lattice step apart. The lattice is bilinear
    between the region's corners.
    """
    corners = region_mm(sensor, protocol)
    sizes = {"train": protocol.train_grid, "validation": protocol.validation_grid, "test": protocol.test_grid}
    parity = {"train": (0, 0), "validation": (1, 0), "test": (1, 1)}
    largest = max(sizes.values())
    positions = {}
    for split, size in sizes.items():
        chosen = np.rint((np.arange(size) + 0.5) / size * largest - 0.5).astype(int)
        along_x, along_y = (2 * (2 * chosen + odd) / (2 * largest - 1) - 1 for odd in parity[split])
        if protocol.corners_mm is None:  # a rectangle: products, whose rounding nothing else shares
            x, y = np.meshgrid(along_x * corners[0, 1, 0], along_y * corners[1, 0, 1])
            positions[split] = np.stack([x.ravel(), y.ravel()], axis=-1)
            continue
        right, down = (np.stack([1 - t, 1 + t], axis=-1) / 2 for t in (along_x, along_y))
        positions[split] = np.einsum("vi,uj,ijk->vuk", down, right, corners).reshape(-1, 2)
    return positions


def stations(scene: Scene) -> list[Station]:
    """All stations of a scene's protocol, in the order in which they are pressed: those of further objects
    come last. A position's object and, of fewer loads than all, its loads are those of its row and column, so
    that each comes to all parts of the skin.
    """
    protocol = scene.protocol
    grids = positions_mm(scene.sensor, protocol)
    visited: list[tuple[str, int, float | str]] = [
        (split, k, protocol.ball_mm) for split, grid in grids.items() for k in range(len(grid))
    ]
    more: tuple[float | str, ...] = (*protocol.more_balls_mm, *protocol.more_shapes)
    for split in ("train", "validation") if more else ():
        size = math.isqrt(len(grids[split]))
        visited += [(split, k, more[(k // size + k % size) % len(more)]) for k in range(size**2)]
    return [
        Station(
            split,
            *map(float, grids[split][place]),
            load_n,
            math.nan if isinstance(what, str) else what,
            tuple(
                (share * load_n * x, share * load_n * y)
                for share in scene.tangential_shares
                for x, y in DIRECTIONS
            ),
            *((what, (protocol.seed, k)) if isinstance(what, str) else ("ball", ())),
            f"{what if isinstance(what, str) else 'ball'} {k}",
        )
        for k, (split, place, what) in enumerate(visited)
        for load_n in _loads_n(protocol, split, divmod(place, math.isqrt(len(grids[split]))))
    ]


def _loads_n(protocol: Protocol, split: str, position: tuple[int, int]) -> list[float]:
    """The loads at a position (row, column) of a split, in the order of `protocol.loads_n`.

    A step along the columns goes on by two loads, where it goes on by one object: so all objects meet all
    loads.
    """
    loads_n, (row, column) = protocol.loads_n, position
    if split == "test" or protocol.loads_per_position is None:
        return list(loads_n)
    chosen = {(row + 2 * column + k) % len(loads_n) for k in range(protocol.loads_per_position)}
    return [loads_n[k] for k in sorted(chosen)]
