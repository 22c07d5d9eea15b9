"""What the camera's frames of a drag tell of slip, and what is true: spread, force ratio, sticking nodes."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fastac.flow import frames
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer.bundle import Bundle
from fastac.models.integer.dot_spread import LEAST_DOTS
from fastac.models.vision.rigid_spread import rigid_spread_px
from fastac.scenes.schema import Scene
from fastac.sensor.geometry import rest_depth_mm
from fastac.sensor.mechanics.fem.rig import FemRig
from fastac.sensor.mechanics.press import ContactError, PressedSkin
from fastac.sensor.optics.marker_grid import marker_pixels
from fastac.store.progress import progress_bar
from fastac.studies.demos.grip_control import friction_ratio
from fastac.studies.slip.drags import Drag, steps

WANTED = ("slip_px", "slip_dots", "slipping", "force_n", "validity")
MOST_STICK = 0.5
"""For the study a state slips if fewer than this share of the nodes in contact stick."""


@dataclass(frozen=True, eq=False)
class DragRecord:
    """One drag: arrays of one entry for each of its n steps."""

    drag: Drag
    sticking: np.ndarray
    """Share of the nodes in contact that stick."""
    slip_px: np.ndarray
    """Spread that the integers find."""
    slip_dots: np.ndarray
    """Dots in contact, by the integers."""
    slipping: np.ndarray
    """bool: the integers' spread is beyond the scene's limit."""
    true_slip_px: np.ndarray
    """Spread of the true shifts, see `true_spread`."""
    true_slip_dots: np.ndarray
    """Dots in contact, by the true displacement."""
    found_force_n: np.ndarray
    """(n, 3), by the integers."""
    true_force_n: np.ndarray
    """(n, 3), by the contact mechanics."""
    suspect: np.ndarray
    """bool: the integers' validity flags mark the frame as suspect."""

    @property
    def slips(self) -> np.ndarray:
        """(n,) bool: fewer than half of the nodes stick."""
        return self.sticking < MOST_STICK

    @property
    def known(self) -> np.ndarray:
        """(n,) bool: both spreads are known, as enough dots are in contact."""
        return np.minimum(self.slip_dots, self.true_slip_dots) >= LEAST_DOTS

    @property
    def measures(self) -> dict[str, np.ndarray]:
        """What is compared, (n,) each: both spreads in px, and F_t/F_z of the forces found."""
        return {
            "integers": self.slip_px,
            "true_shifts": self.true_slip_px,
            "force_ratio": friction_ratio(self.found_force_n),
        }


def true_spread(scene: Scene, pressed: PressedSkin) -> tuple[float, int]:
    """The spread in px of the true shifts of the dots in contact, and how many these are.

    A dot is in contact where the skin's true displacement at its place at rest exceeds `slip.contact_mm`.
    """
    sensor = scene.sensor
    rest_px = marker_pixels(sensor)
    column, row = np.rint(rest_px).astype(int).T
    contact = (rest_depth_mm(sensor) - pressed.depth_mm)[row, column] > scene.slip.contact_mm
    shift_px = marker_pixels(sensor, pressed.tangential_mm) - rest_px
    return rigid_spread_px(rest_px[contact], shift_px[contact]), int(contact.sum())


def _measured(scene: Scene, emulator: Emulator, rig: FemRig, drag: Drag, rng) -> DragRecord:
    """One drag; ContactError as `steps`."""
    taken = list(steps(rig, drag))
    images = np.stack([frames.of_press(step.pressed, scene.sensor, rng) for step in taken])
    found = emulator.run(images, wanted=WANTED)
    true_px, true_dots = zip(*(true_spread(scene, step.pressed) for step in taken), strict=True)
    return DragRecord(
        drag,
        np.array([step.sticking for step in taken]),
        found.slip_px,
        found.slip_dots,
        found.slipping,
        np.array(true_px),
        np.array(true_dots),
        found.force_n.astype(np.float64),
        np.array([step.pressed.force_n for step in taken]),
        found.validity != 0,
    )


def record(
    bundle: Bundle, rig: FemRig, drags: list[Drag], *, progress: bool
) -> Iterator[DragRecord | ContactError]:
    """What was measured in each drag, or the load or pull that its contact cannot carry."""
    scene, emulator = bundle.scene, Emulator(bundle.pipeline)
    rng = np.random.default_rng(scene.protocol.seed)
    for drag in progress_bar(drags, desc="slip", unit="drag", enabled=progress):
        try:
            yield _measured(scene, emulator, rig, drag, rng)
        except ContactError as error:
            yield error
