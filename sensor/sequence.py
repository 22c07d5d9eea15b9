"""Contacts in time: an indenter stays on the virtual skin and is led from one load to the next.

Each state is an equilibrium, for the gel settles faster than a camera sees: no inertia, no viscosity.
Frames are instantaneous: an exposure of T would leave sin(πfT)/(πfT) of the amplitude at f, 98.4% at 100 Hz
and 1 ms.
"""

from typing import Protocol

from fastac.sensor.layer_rig import LayerRig
from fastac.sensor.protocol import Station
from fastac.sensor.rig import Pressed, Rig


class Probe(Protocol):
    def at_load(self, load_n: float) -> Pressed:
        """The next state: led along z until F_z = load_n; the pose has `approach_mm`, from first touch.

        Raises ContactError for a load that cannot be carried.
        """


class LayerProbe:
    """A ball on the elastic layer, whose states do not depend on what was before."""

    def __init__(self, rig: LayerRig, ball_mm: float, x_mm: float, y_mm: float):
        self._rig, self._ball_mm, self._at = rig, ball_mm, (x_mm, y_mm)

    def at_load(self, load_n: float) -> Pressed:
        (pressed,) = self._rig.presses(Station("test", *self._at, load_n), self._ball_mm)
        return pressed


def probe_of(rig: Rig, ball_mm: float, x_mm: float, y_mm: float) -> Probe:
    """A ball over the skin of either rig."""
    if isinstance(rig, LayerRig):
        return LayerProbe(rig, ball_mm, x_mm, y_mm)
    from fastac.sensor.fem_probe import FemProbe  # scikit-fem is slow to load, and a layer does without
    from fastac.sensor.indenter import Ball

    return FemProbe(rig, Ball(ball_mm), x_mm, y_mm)
