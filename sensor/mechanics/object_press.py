"""Test objects pressed on the virtual sensor: the skin, and the force on it pixel by pixel.

On the elastic layer, which is solved at the pixels: the finite-element mesh is coarser than a pit or a ridge.
"""

from dataclasses import dataclass

import numpy as np

from fastac.sensor.geometry import normals_from_slopes, slopes_less
from fastac.sensor.mechanics.indenter import HeightMap
from fastac.sensor.mechanics.layer import Layer
from fastac.sensor.mechanics.press import Pressed


@dataclass(frozen=True)
class ObjectPress:
    pressed: Pressed
    force_map_n: np.ndarray
    """(H, W, 3) force of each pixel's skin on the object; its sum is the resultant."""


def press_object(layer: Layer, height_map: HeightMap, name: str, load_n: float) -> ObjectPress:
    """Press an object on the middle of the skin along −z with `load_n`.

    Where the skin touches the object its slopes are the object's own. Without friction the force of a pixel
    with pressure P is (−p, −q, 1)·P times its area. Raises ContactError for a load that is too much.
    """
    z, p_object, q_object = height_map.surface(layer.x_mm, layer.y_mm)
    contact = layer.press_surface(z, load_n=load_n, what=name)
    p, q = slopes_less(contact.displacement_mm, layer.sensor)
    touching = contact.pressure_mpa > 0
    p[touching], q[touching] = p_object[touching], q_object[touching]
    force = contact.pressure_mpa * layer.sensor.pitch_mm**2
    force_map = np.stack([-p * force, -q * force, force], axis=-1)
    pose = {"approach_mm": contact.approach_mm, "load_n": load_n}
    depth = layer.rest_depth_mm - contact.displacement_mm
    pressed = Pressed(normals_from_slopes(p, q), depth, touching, force_map.sum(axis=(0, 1)), pose)
    return ObjectPress(pressed, force_map)
