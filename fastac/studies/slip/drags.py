"""Objects that are dragged over the virtual fingertip, nearly until they slide.

An object is pressed down until F_z is the drag's load, and is then pulled along x by a force that rises in
steps, at constant F_z. Friction could carry μ F_z. As the pull rises, ever fewer of the skin's nodes in
contact stick to the object (sensor/mechanics/fem/contact.py): they slide first at the rim of the contact, and
no node sticks once the object slides. A drag is simulated for each object, place, load and friction.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from fastac.scenes.schema import Scene
from fastac.sensor.mechanics.fem.contact import Load
from fastac.sensor.mechanics.fem.probe import FemProbe
from fastac.sensor.mechanics.fem.rig import FemRig
from fastac.sensor.mechanics.indenter import Ball, Cylinder, Indenter
from fastac.sensor.mechanics.press import PressedSkin

OBJECTS: Mapping[str, Indenter] = {
    "ball 5 mm": Ball(5.0),
    "ball 10 mm": Ball(10.0),
    "ball 20 mm": Ball(20.0),
    "cylinder 65 mm": Cylinder(65.0, 300.0),
}
"""Indenters by the names in tables and figures. The cylinder's axis is along x, that of the pull."""
PLACES = ((0.0, 0.0), (0.5, 0.3125))
"""x and y of the object's axis in spacings of the dots: on a dot, and between dots."""
SHARES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98)
"""Pulls of a drag, as shares of what friction carries."""
REACH = 0.4
"""Largest indentation in thicknesses of the elastomer."""


@dataclass(frozen=True)
class Drag:
    """One object at one place, under one load and with one coefficient of friction."""

    name: str
    """Of the object, as in OBJECTS."""
    indenter: Indenter = field(repr=False)
    x_mm: float
    y_mm: float
    load_n: float
    friction: float


@dataclass(frozen=True, eq=False)
class DragStep:
    """The equilibrium at one pull of a drag."""

    share: float
    """The pull, as a share of what friction carries."""
    sticking: float
    """Share of the nodes in contact that stick."""
    pressed: PressedSkin


def drags(scene: Scene, objects: Mapping[str, Indenter] = OBJECTS) -> list[Drag]:
    """All drags of a scene: each load of its protocol, with its friction and with half of it."""
    sensor = scene.sensor
    frictions = (sensor.elastomer.friction, sensor.elastomer.friction / 2)
    cases = product(frictions, objects.items(), PLACES, scene.protocol.loads_n)
    spacing_mm = sensor.markers.spacing_mm
    return [
        Drag(name, indenter, x * spacing_mm, y * spacing_mm, load_n, friction)
        for friction, (name, indenter), (x, y), load_n in cases
    ]


def steps(rig: FemRig, drag: Drag) -> Iterator[DragStep]:
    """Press, then pull ever more strongly: one step for each of SHARES.

    Raises ContactError for a load, or a pull, that the contact cannot carry.
    """
    reach_mm = REACH * rig.sensor.elastomer.thickness_mm
    probe = FemProbe(rig, drag.indenter, drag.x_mm, drag.y_mm, reach_mm=reach_mm, friction=drag.friction)
    probe.at_load(drag.load_n)
    for share in SHARES:
        force_n = np.array([-share * drag.friction * drag.load_n, 0.0, drag.load_n])
        probe.apply_load(Load(np.eye(3), np.ones(3, bool), force_n))
        yield DragStep(share, probe.state.sticking_share, probe.pressed())
