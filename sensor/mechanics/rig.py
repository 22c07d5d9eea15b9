"""Contacts in time: an indenter stays on the virtual skin and is led from one load to the next.

Each state is an equilibrium, for the gel settles faster than a camera sees: no inertia, no viscosity.
Frames are instantaneous: an exposure of T would leave sin(πfT)/(πfT) of the amplitude at f, 98.4% at 100 Hz
and 1 ms.
"""

from pathlib import Path

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.mechanics.layer_rig import LayerProbe, LayerRig
from fastac.sensor.mechanics.press import Probe, Rig


def rig_of(sensor: Sensor, store: Path | str, *, progress: bool = True) -> Rig:
    """The gel that the scene asks for; `store` is where a finite-element compliance is kept."""
    if sensor.elastomer.mechanics == "layer":
        from fastac.sensor.mechanics.layer_rig import LayerRig

        return LayerRig(sensor)
    from fastac.sensor.mechanics.fem.rig import FemRig  # scikit-fem is slow to load, and a layer does without

    return FemRig(sensor, store, progress=progress)


def probe_of(rig: Rig, ball_mm: float, x_mm: float, y_mm: float) -> Probe:
    """A ball over the skin of either rig."""
    if isinstance(rig, LayerRig):
        return LayerProbe(rig, ball_mm, x_mm, y_mm)
    from fastac.sensor.mechanics.fem.probe import (
        FemProbe,  # scikit-fem is slow to load, and a layer does without
    )
    from fastac.sensor.mechanics.indenter import Ball

    return FemProbe(rig, Ball(ball_mm), x_mm, y_mm)
