"""Where a ball is pressed and how hard: the paper's protocol (supplement, section I).

Positions are of the ball's axis, in mm from the image's centre. Three grids share no point: train,
validation, test. At each position come the vertical loads, and after each of them, where the scene has
tangential loads, those in four in-plane directions.
"""

from dataclasses import dataclass

import numpy as np

from fastac.scenes.schema import Protocol, Scene
from fastac.scenes.sensor_schema import Sensor

MARGIN_BALLS = 0.3
"""Distance from the fixed rim to the outermost positions, in ball diameters: as much as the contact grows."""
DIRECTIONS = ((1, 0), (-1, 0), (0, 1), (0, -1))
"""Of tangential loads, in x and y."""


class FingertipError(ValueError):
    """A scene that the virtual fingertip cannot press; the message is one line with key and value."""


@dataclass(frozen=True)
class Station:
    """One vertical load at one position, and the tangential loads that follow it."""

    split: str
    x_mm: float
    y_mm: float
    load_n: float
    tangential_n: tuple[tuple[float, float], ...] = ()

    @property
    def targets_n(self) -> tuple[tuple[float, float], ...]:
        """(F_x, F_y) that each sample is dragged to; the first one is not dragged."""
        return ((0.0, 0.0), *self.tangential_n)


def region_mm(sensor: Sensor, protocol: Protocol) -> np.ndarray:
    """The corners of what is pressed, (2, 2, 2): by row and column of the image, x and y."""
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

    All three grids are taken from one lattice of 2m × 2m points, m the largest grid: train from the points
    that are even along both axes, test odd along both, validation odd along x and even along y. So no two
    splits come closer than one step of the lattice. The lattice is bilinear between the region's corners.
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
    """All stations of a scene's protocol, in the order in which they are visited."""
    return [
        Station(
            split,
            *map(float, position),
            load_n,
            tuple(
                (share * load_n * x, share * load_n * y)
                for share in scene.tangential_shares
                for x, y in DIRECTIONS
            ),
        )
        for split, grid in positions_mm(scene.sensor, scene.protocol).items()
        for position in grid
        for load_n in scene.protocol.loads_n
    ]
