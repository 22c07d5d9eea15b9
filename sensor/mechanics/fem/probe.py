"""An indenter that stays in contact with the finite-element gel while its load changes.

Friction makes each state depend on the previous one: nodes that slid stay where they slid to.
"""

import numpy as np
from threadpoolctl import threadpool_limits

from fastac.sensor.mechanics.fem.contact import GAP_TOLERANCE_MM, Load, NotConvergedError, State
from fastac.sensor.mechanics.fem.rig import FemRig
from fastac.sensor.mechanics.fem.skin import skin_of
from fastac.sensor.mechanics.indenter import Indenter
from fastac.sensor.mechanics.press import ContactError, PressedSkin

FIRST_STEPS = 4
"""Load steps of the first load, which starts without contact."""
VERTICAL = np.array([False, False, True])


class FemProbe:
    """An indenter at (x_mm, y_mm) on the gel of a rig; see `press.Probe`.

    reach_mm : the largest approach to be expected, by default the elastomer's thickness; a smaller one gives
        a smaller contact problem
    friction : Coulomb's coefficient, by default that of the rig's scene
    """

    def __init__(
        self,
        rig: FemRig,
        indenter: Indenter,
        x_mm: float,
        y_mm: float,
        *,
        reach_mm: float | None = None,
        friction: float | None = None,
    ):
        elastomer = rig.sensor.elastomer
        reach_mm = elastomer.thickness_mm if reach_mm is None else reach_mm
        friction = elastomer.friction if friction is None else friction
        with threadpool_limits(1):
            self._setup = rig.gel.set_up_contact(indenter, x_mm, y_mm, friction=friction, reach_mm=reach_mm)
        self._rig = rig
        self.state = self._setup.problem.unloaded()
        """The present equilibrium. It may be set to an earlier one, to continue from there."""

    @property
    def indenter_displacement_mm(self) -> np.ndarray:
        """(3,) displacement of the indenter from first touch along x, y, z."""
        return self.state.indenter_displacement_mm

    def at_load(self, load_n: float) -> PressedSkin:
        self.apply_load(Load(np.eye(3), VERTICAL, np.array([0.0, 0.0, load_n])))
        return self.pressed()

    def apply_load(self, load: Load) -> np.ndarray:
        """Go on to the equilibrium under `load`; returns how far the indenter slid, (3,) in mm.

        The indenter slid by the smallest slip, along its displacement in x and y, of the nodes that are in
        contact before and after: zero while one of them sticks. Raises ContactError for a load that friction
        cannot carry, and then leaves the state unchanged.
        """
        before = self.state
        with threadpool_limits(1):  # or the sums' order, and so the last bits, would depend on the machine
            try:
                steps = 1 if before.force.any() else FIRST_STEPS
                self.state = self._setup.problem.apply_load(before, load, steps)
            except NotConvergedError:
                raise ContactError(f"{self._where}: no equilibrium: more than it can carry") from None
        return self._slid(before, self.state)

    def pressed(self) -> PressedSkin:
        """The skin in the present state. Raises ContactError where the gel cannot represent it; see `Gel`."""
        setup, sensor, indenter_displacement_mm = self._setup, self._rig.sensor, self.indenter_displacement_mm
        with threadpool_limits(1):
            contact = self._rig.gel.contact(setup, self.state, self._where)
            skin = skin_of(contact, sensor, setup.indenter, setup.x_mm, setup.y_mm)
        pose = {
            "x_mm": setup.x_mm + indenter_displacement_mm[0],
            "y_mm": setup.y_mm + indenter_displacement_mm[1],
            "z_mm": contact.first_touch_mm + indenter_displacement_mm[2],
            "approach_mm": -indenter_displacement_mm[2],
        }
        return PressedSkin(
            skin.normals, skin.depth_mm, skin.in_contact, contact.force_n, pose, skin.tangential_mm
        )

    @property
    def _where(self) -> str:
        setup = self._setup
        return f"{type(setup.indenter).__name__} at x = {setup.x_mm:g} mm, y = {setup.y_mm:g} mm"

    def _slid(self, before: State, after: State) -> np.ndarray:
        moved = after.indenter_displacement_mm - before.indenter_displacement_mm
        moved[2] = 0
        length = np.linalg.norm(moved)
        both = (before.force[:, 0] > 0) & (after.force[:, 0] > 0)
        if not length or not both.any():
            return np.zeros(3)
        slip = (after.slip_mm - before.slip_mm)[both]  # of the skin relative to the indenter
        along = -np.einsum("ik,ikb,b->i", slip, self._setup.problem.frame[both, 1:], moved / length)
        return (along.min() if along.min() > GAP_TOLERANCE_MM else 0.0) * moved / length
