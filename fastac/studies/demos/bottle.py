"""A bottle between two virtual fingertips, and a hand that pushes it down.

The bottle is a rigid upright cylinder, its axis along the image's x, which points down. Both fingers press
straight at it, and by symmetry each carries half of every load, so that one of them is simulated. How far
the finger has come towards the bottle is given by the angle between the fingers; its force follows from the
gel. The hand follows its own course, pushes the cap through a spring, and leaves it when it goes back.
Contact is that of sensor/mechanics/fem/contact.py: where Coulomb's friction cannot carry weight and hand, every node
slides, and the bottle comes down until the hand's spring has slackened.
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
"""The bottle's length in images, and the deepest that it sinks in thicknesses of the elastomer."""


@dataclass(frozen=True)
class Grasp:
    """What fingers, bottle and hand do. Forces not given are stated shares of the scene's largest load."""

    bottle_mm: float = 65.0
    """Diameter."""
    lever_mm: float = 50.0
    """From a finger's joint to the fingertip's contact."""
    grip_n: float | None = None
    """Force of each finger before anything pushes: a third."""
    weight_n: float | None = None
    """Of the bottle: 0.15."""
    hand_n_per_mm: float | None = None
    """Stiffness of the hand on the cap: 0.4 of the largest load."""
    pushes_n: tuple[float, ...] | None = None
    """What the hand would press the cap with if it did not move, push by push: 0.2, 0.4, 0.6, 0.8."""
    push_s: float = 0.4
    pause_s: float = 0.2
    step_deg: float = 0.05
    """By which the angle between the fingers is made smaller."""
    most_deg: float = 1.0
    """By which it is made smaller at most."""
    stable_share: float = 0.5
    """μ_s over the μ that was found where the bottle slipped."""
    margin_share: float = 0.1
    """d over the same."""

    def of_scene(self, scene: Scene) -> "Grasp":
        """With every force in N. Raises FingertipError for what cannot be."""
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
        return self.pause_s + len(self.pushes_n) * (self.push_s + self.pause_s)

    def push_n(self, time_s: float) -> float:
        """What the hand would press with if the bottle had not moved since the push began: a sine squared."""
        push, within = divmod(time_s - self.pause_s, self.push_s + self.pause_s)
        if push < 0 or within >= self.push_s or push >= len(self.pushes_n):
            return 0.0
        return self.pushes_n[int(push)] * np.sin(np.pi * within / self.push_s) ** 2


class Hold:
    """One fingertip on the bottle, and its half of the hand."""

    def __init__(self, rig: FemRig, grasp: Grasp):
        self.grasp, sensor = grasp, rig.sensor
        bottle = Cylinder(grasp.bottle_mm, LENGTHS * sensor.width_px * sensor.pitch_mm)
        self.probe = FemProbe(rig, bottle, 0.0, 0.0, reach_mm=REACH * sensor.elastomer.thickness_mm)
        self.probe.at_load(grasp.grip_n)
        self.closed_mm = float(self.probe.indenter_displacement_mm[2])
        self.hand_from_mm: float | None = None
        """Where the bottle was when the push began; None: no push."""
        self.hand_n = 0.0
        self.slipped_mm = 0.0
        self.step(0.0, 0.0)

    @property
    def lowered_mm(self) -> float:
        """How far the bottle has come down since it was gripped: with the skin, and slipping."""
        return float(self.probe.indenter_displacement_mm[0])

    def step(self, push_n: float, tightened_deg: float) -> PressedSkin:
        """The next state, with the hand where it would press with `push_n` had the bottle not moved, and the
        angle between the fingers `tightened_deg` smaller than at first.

        Raises ContactError where the bottle falls, and where the gel is too thin.
        """
        grasp, before = self.grasp, self.probe.state
        way_z_mm = self.closed_mm - grasp.lever_mm * np.radians(tightened_deg / 2)
        if push_n == 0:
            self.hand_from_mm = None
        elif self.hand_from_mm is None:
            self.hand_from_mm = self.lowered_mm
        spring, self.hand_n = grasp.hand_n_per_mm / 2, 0.0
        if push_n > 0:
            hand_mm = self.hand_from_mm + push_n / grasp.hand_n_per_mm
            slid_mm = self._lead(grasp.weight_n / 2 + spring * hand_mm, way_z_mm, spring)
            self.hand_n = 2 * spring * (hand_mm - self.lowered_mm)
        if self.hand_n <= 0:  # a hand pushes and does not pull
            self.hand_n, self.probe.state = 0.0, before
            slid_mm = self._lead(grasp.weight_n / 2, way_z_mm, 0.0)
        self.slipped_mm += abs(slid_mm[0])
        return self.probe.pressed()

    def _lead(self, down_n: float, way_z_mm: float, spring_n_per_mm: float) -> np.ndarray:
        value, force_controlled = np.array([-down_n, 0.0, way_z_mm]), np.array([True, False, False])
        return self.probe.apply_load(
            Load(np.eye(3), force_controlled, value, np.array([spring_n_per_mm, 0.0, 0.0]))
        )
