"""Selection of the contact model: the rig of a sensor's gel, and a probe that stays in contact on it.

Every state is a static equilibrium, without inertia or viscosity: the gel is assumed to settle faster than
the camera's frame time. Frames are instantaneous: an exposure of duration T would reduce the amplitude of a
vibration of frequency f by sin(πfT)/(πfT), to 98.4% at 100 Hz and 1 ms.
"""

from pathlib import Path

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.mechanics.layer_rig import LayerProbe, LayerRig
from fastac.sensor.mechanics.press import Probe, Rig


def rig_of(sensor: Sensor, store: Path | str, *, progress: bool = True) -> Rig:
    """The rig for the sensor's contact model; `store` is the folder of the step store."""
    if sensor.elastomer.mechanics == "layer":
        return LayerRig(sensor)
    from fastac.sensor.mechanics.fem.rig import FemRig  # scikit-fem is slow to load, and a layer does without

    return FemRig(sensor, store, progress=progress)


def probe_of(rig: Rig, ball_mm: float, x_mm: float, y_mm: float) -> Probe:
    """A ball of diameter `ball_mm` above (x_mm, y_mm) on the gel of a rig, not yet in contact."""
    if isinstance(rig, LayerRig):
        return LayerProbe(rig, ball_mm, x_mm, y_mm)
    from fastac.sensor.mechanics.fem.probe import (
        FemProbe,  # scikit-fem is slow to load, and a layer does without
    )
    from fastac.sensor.mechanics.indenter import Ball

    return FemProbe(rig, Ball(ball_mm), x_mm, y_mm)
