"""Presses on the elastic layer: slopes, depth and force from the layer's displacement and pressure."""

from dataclasses import replace

import numpy as np

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.geometry import ball_slopes, deformed_slopes, normals_from_slopes
from fastac.sensor.mechanics.indenter import Indenter
from fastac.sensor.mechanics.layer import Contact, Layer
from fastac.sensor.mechanics.press import PressedSkin
from fastac.sensor.mechanics.random_indenter import indenter_of
from fastac.sensor.protocol import Station


def surface(contact: Contact, layer: Layer, x_mm: float, y_mm: float, ball_mm: float):
    """Normals (H, W, 3) and depth_mm (H, W), float64, of the skin deformed by a ball at (x_mm, y_mm).

    Where the skin touches the ball its slopes are the ball's.
    """
    p, q = deformed_slopes(contact.displacement_mm, layer.sensor)
    in_contact = contact.pressure_mpa > 0
    p[in_contact], q[in_contact] = ball_slopes(
        layer.x_mm[in_contact] - x_mm, layer.y_mm[in_contact] - y_mm, ball_mm
    )
    return normals_from_slopes(p, q), layer.rest_depth_mm - contact.displacement_mm


def contact_force_n(contact: Contact, layer: Layer, x_mm: float, y_mm: float, ball_mm: float) -> np.ndarray:
    """Force of the skin on the ball, (3,) in N, z positive in compression.

    Without friction the pressure acts along the surface's normal: a pressure P per area of the image plane
    gives (−p, −q, 1)·P, with the ball's slopes p, q. So a vertical press on a tilted skin has tangential
    forces too.
    """
    in_contact = contact.pressure_mpa > 0
    p, q = ball_slopes(layer.x_mm[in_contact] - x_mm, layer.y_mm[in_contact] - y_mm, ball_mm)
    pressure = contact.pressure_mpa[in_contact] * layer.sensor.pitch_mm**2
    return np.array([-(p * pressure).sum(), -(q * pressure).sum(), pressure.sum()])


def press_indenter(layer: Layer, indenter: Indenter, x_mm: float, y_mm: float, load_n: float) -> PressedSkin:
    """The skin under an indenter whose axis is at (x_mm, y_mm). Raises ContactError as `Layer`."""
    z, p_object, q_object = indenter.surface(layer.x_mm - x_mm, layer.y_mm - y_mm)
    contact = layer.press_surface(z, load_n=load_n)
    p, q = deformed_slopes(contact.displacement_mm, layer.sensor)
    touching = contact.pressure_mpa > 0
    p[touching], q[touching] = p_object[touching], q_object[touching]
    force = contact.pressure_mpa * layer.sensor.pitch_mm**2
    depth_mm = layer.rest_depth_mm - contact.displacement_mm
    force_n = np.array([-(p * force).sum(), -(q * force).sum(), force.sum()])
    pose = {"x_mm": x_mm, "y_mm": y_mm, "approach_mm": contact.approach_mm}
    return PressedSkin(normals_from_slopes(p, q), depth_mm, touching, force_n, pose)


class LayerRig:
    """The frictionless elastic layer of a sensor; see `press.Rig`."""

    def __init__(self, sensor: Sensor):
        self.layer = Layer(sensor)

    def presses(self, station: Station) -> list[PressedSkin]:
        """The one sample of a station: the layer is frictionless, so it has no tangential loads."""
        x_mm, y_mm, ball_mm = station.x_mm, station.y_mm, station.ball_mm
        if station.shape != "ball":
            return [self._pressed_by_shape(station)]
        contact = self.layer.press(x_mm, y_mm, ball_mm=ball_mm, load_n=station.load_n)
        normals, depth_mm = surface(contact, self.layer, x_mm, y_mm, ball_mm)
        pose = {
            "x_mm": x_mm,
            "y_mm": y_mm,
            "ball_mm": ball_mm,
            "approach_mm": contact.approach_mm,
            "contact_radius_mm": contact.contact_radius_mm,
        }
        force = contact_force_n(contact, self.layer, x_mm, y_mm, ball_mm)
        return [PressedSkin(normals, depth_mm, contact.pressure_mpa > 0, force, pose)]

    def _pressed_by_shape(self, station: Station) -> PressedSkin:
        where = station.x_mm, station.y_mm
        pressed = press_indenter(self.layer, indenter_of(station), *where, station.load_n)
        area_mm2 = pressed.in_contact.sum() * self.layer.sensor.pitch_mm**2
        size = {"ball_mm": station.ball_mm, "contact_radius_mm": np.sqrt(area_mm2 / np.pi)}
        return replace(pressed, pose=pressed.pose | size)


class LayerProbe:
    """A ball on the elastic layer; without friction each state follows from its load alone."""

    def __init__(self, rig: LayerRig, ball_mm: float, x_mm: float, y_mm: float):
        self._rig, self._ball_mm, self._at = rig, ball_mm, (x_mm, y_mm)

    def at_load(self, load_n: float) -> PressedSkin:
        (pressed,) = self._rig.presses(Station("test", *self._at, load_n, self._ball_mm))
        return pressed
