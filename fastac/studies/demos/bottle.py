"""Contact mechanics of a bottle gripped by two virtual fingertips while a hand pushes it down.

The bottle is a rigid upright cylinder, its axis along the image's x, which points down. Both fingers press
straight at it, and by symmetry each carries half of every load, so that only one finger is simulated. The
angle between the fingers sets how far the finger is displaced towards the bottle; its force follows from
the gel's deformation. The hand moves as prescribed, pushes on the cap through a spring, and loses contact
when it retreats. Contact is that of sensor/mechanics/fem/contact.py: where Coulomb friction cannot carry
the weight and the hand, every node slides, and the bottle descends until the hand's spring has relaxed.
"""

from dataclasses import asdict, dataclass, replace

import numpy as np

from fastac.scenes.schema import Scene
from fastac.sensor.mechanics.fem.contact import Load
from fastac.sensor.mechanics.fem.probe import FemProbe
from fastac.sensor.mechanics.fem.rig import FemRig
from fastac.sensor.mechanics.indenter import Cylinder
from fastac.sensor.mechanics.press import PressedSkin
from fastac.sensor.protocol import FingertipError

LENGTHS, REACH = 20, 0.4
"""Length of the bottle in widths of the image; largest indentation in thicknesses of the elastomer."""


@dataclass(frozen=True)
class Grasp:
    """Parameters of fingers, bottle, hand and controller.

    A force of None becomes the stated share of the largest load in the scene's protocol; see `of_scene`.
    """

    bottle_mm: float = 65.0
    """Diameter."""
    lever_mm: float = 50.0
    """Distance from a finger's joint to the contact of its fingertip."""
    grip_n: float | None = None
    """Normal force of each finger before the first push; default: 1/3 of the largest load."""
    weight_n: float | None = None
    """Weight of the bottle; default: 0.15 of the largest load."""
    hand_n_per_mm: float | None = None
    """Stiffness of the spring between hand and cap; default: 0.4 of the largest load, per mm."""
    pushes_n: tuple[float, ...] | None = None
    """Peak force of each push if the cap did not yield; default: 0.2, 0.4, 0.6, 0.8 of the largest load."""
    push_s: float = 0.4
    """Duration of a push."""
    pause_s: float = 0.2
    """Pause before each push and after the last."""
    step_deg: float = 0.05
    """Decrease of the angle between the fingers per step of the controller."""
    most_deg: float = 1.0
    """Largest decrease of that angle."""
    stable_share: float = 0.5
    """μ_s of the controller, as a share of the μ at which the slip test found slip."""
    margin_share: float = 0.1
    """The controller's margin d, as a share of the same μ."""

    def of_scene(self, scene: Scene) -> "Grasp":
        """The same parameters with every force set, in N.

        Raises FingertipError for values that are not positive, and for a bottle too heavy for the grip.
        """
        largest = max(scene.protocol.loads_n)
        shares = {"grip_n": 1 / 3, "weight_n": 0.15, "hand_n_per_mm": 0.4}
        stated = {key: share * largest for key, share in shares.items()}
        stated["pushes_n"] = tuple(share * largest for share in (0.2, 0.4, 0.6, 0.8))
        whole = replace(self, **{key: value for key, value in stated.items() if getattr(self, key) is None})
        for key, value in asdict(whole).items():
            numbers = np.atleast_1d(value)
            if not (numbers.size and ((numbers > 0) & (numbers < np.inf)).all()):
                raise FingertipError(f"grasp: {key} = {value}: expected more than 0")
        carried = scene.sensor.elastomer.friction * whole.grip_n
        if whole.weight_n / 2 >= carried:
            carried_n = f"{2 * carried:g} N that friction carries"
            raise FingertipError(f"grasp: weight_n = {whole.weight_n:g}: expected less than the {carried_n}")
        return whole

    @property
    def seconds(self) -> float:
        """Duration of all pushes and pauses."""
        return self.pause_s + len(self.pushes_n) * (self.push_s + self.pause_s)

    def push_n(self, time_s: float) -> float:
        """Force of the hand had the bottle not moved since the push began: a squared sine over each push."""
        push, within = divmod(time_s - self.pause_s, self.push_s + self.pause_s)
        if push < 0 or within >= self.push_s or push >= len(self.pushes_n):
            return 0.0
        return self.pushes_n[int(push)] * np.sin(np.pi * within / self.push_s) ** 2


class HeldBottle:
    """State of the grasp: one fingertip on the bottle, and the hand."""

    def __init__(self, rig: FemRig, grasp: Grasp):
        self.grasp, sensor = grasp, rig.sensor
        bottle = Cylinder(grasp.bottle_mm, LENGTHS * sensor.width_px * sensor.pitch_mm)
        self.probe = FemProbe(rig, bottle, 0.0, 0.0, reach_mm=REACH * sensor.elastomer.thickness_mm)
        self.probe.at_load(grasp.grip_n)
        self.grip_z_mm = float(self.probe.indenter_displacement_mm[2])
        """Displacement of the bottle along z, against the fingertip, at the initial grip."""
        self.push_start_mm: float | None = None
        """Position of the bottle when the present push began; None between pushes."""
        self.hand_n = 0.0
        self.slipped_mm = 0.0
        self.step(0.0, 0.0)

    @property
    def lowered_mm(self) -> float:
        """Downward displacement of the bottle since it was gripped: the skin's shear and slip together."""
        return float(self.probe.indenter_displacement_mm[0])

    def step(self, push_n: float, tightened_deg: float) -> PressedSkin:
        """Advance by one frame and return the contact's state.

        push_n : force of the hand had the bottle not moved since the push began; it sets the hand's position
        tightened_deg : decrease of the angle between the fingers since the start

        Raises ContactError where the bottle falls, and where the indentation exceeds the gel.
        """
        grasp, before = self.grasp, self.probe.state
        bottle_z_mm = self.grip_z_mm - grasp.lever_mm * np.radians(tightened_deg / 2)
        if push_n == 0:
            self.push_start_mm = None
        elif self.push_start_mm is None:
            self.push_start_mm = self.lowered_mm
        spring, self.hand_n = grasp.hand_n_per_mm / 2, 0.0
        if push_n > 0:
            hand_mm = self.push_start_mm + push_n / grasp.hand_n_per_mm
            slip_mm = self._solve(grasp.weight_n / 2 + spring * hand_mm, bottle_z_mm, spring)
            self.hand_n = 2 * spring * (hand_mm - self.lowered_mm)
        if self.hand_n <= 0:  # a hand pushes and does not pull
            self.hand_n, self.probe.state = 0.0, before
            slip_mm = self._solve(grasp.weight_n / 2, bottle_z_mm, 0.0)
        self.slipped_mm += abs(slip_mm[0])
        return self.probe.pressed()

    def _solve(self, down_n: float, bottle_z_mm: float, spring_n_per_mm: float) -> np.ndarray:
        """Move the bottle to equilibrium; returns how far (3,) in mm it has slipped."""
        value, force_controlled = np.array([-down_n, 0.0, bottle_z_mm]), np.array([True, False, False])
        return self.probe.apply_load(
            Load(np.eye(3), force_controlled, value, np.array([spring_n_per_mm, 0.0, 0.0]))
        )
