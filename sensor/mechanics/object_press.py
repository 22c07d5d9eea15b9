"""Presses of test objects on the elastic layer: the deformed skin and the force of every pixel.

The layer model is used because it is solved at every pixel: the finite-element mesh is too coarse for the
objects' pits and ridges.
"""

from dataclasses import dataclass

import numpy as np

from fastac.sensor.geometry import deformed_slopes, normals_from_slopes
from fastac.sensor.mechanics.indenter import HeightMap
from fastac.sensor.mechanics.layer import Layer
from fastac.sensor.mechanics.press import PressedSkin


@dataclass(frozen=True)
class ObjectPress:
    """A pressed object: the skin, and how the force is distributed over it."""

    pressed: PressedSkin
    force_map_n: np.ndarray
    """(H, W, 3) force in N of each pixel's skin on the object; its sum is the resultant."""


def press_object(layer: Layer, height_map: HeightMap, name: str, load_n: float) -> ObjectPress:
    """Press an object on the middle of the skin along −z with `load_n`.

    Where the skin touches the object its slopes are the object's. Without friction the force of a pixel with
    pressure P is (−p, −q, 1)·P times its area. Raises ContactError for a load beyond the contact model.
    """
    z, p_object, q_object = height_map.surface(layer.x_mm, layer.y_mm)
    contact = layer.press_surface(z, load_n=load_n, what=name)
    p, q = deformed_slopes(contact.displacement_mm, layer.sensor)
    in_contact = contact.pressure_mpa > 0
    p[in_contact], q[in_contact] = p_object[in_contact], q_object[in_contact]
    force = contact.pressure_mpa * layer.sensor.pitch_mm**2
    force_map = np.stack([-p * force, -q * force, force], axis=-1)
    pose = {"approach_mm": contact.approach_mm, "load_n": load_n}
    depth = layer.rest_depth_mm - contact.displacement_mm
    pressed = PressedSkin(normals_from_slopes(p, q), depth, in_contact, force_map.sum(axis=(0, 1)), pose)
    return ObjectPress(pressed, force_map)
