"""Presses on the finite-element gel: vertical loads, then tangential ones."""

from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.mechanics.fem.gel import Gel
from fastac.sensor.mechanics.fem.pressed_gel import GelContact
from fastac.sensor.mechanics.fem.skin import skin_of
from fastac.sensor.mechanics.indenter import Indenter
from fastac.sensor.mechanics.press import ContactError, PressedSkin
from fastac.sensor.mechanics.random_indenter import indenter_of
from fastac.sensor.protocol import Station


class FemRig:
    """The gel of a sensor, see `press.Rig`; its compliance is kept in the step store in the folder
    `store`."""

    def __init__(self, sensor: Sensor, store: Path | str, *, progress: bool = True):
        self.sensor = sensor
        elements, layers = sensor.elastomer.elements, sensor.elastomer.layers
        self.gel = Gel.of_sensor(sensor, store, elements=elements, layers=layers, progress=progress)

    def presses(self, station: Station) -> list[PressedSkin | ContactError]:
        """The vertical sample of a station and its tangential ones; see `press.Rig`."""
        indenter = indenter_of(station)
        with threadpool_limits(1):  # or the sums' order, and so the last bits, would depend on the machine
            contacts = self.gel.presses(
                indenter,
                station.x_mm,
                station.y_mm,
                load_n=station.load_n,
                friction=self.sensor.elastomer.friction,
                tangential_loads_n=station.tangential_n,
            )
            return [
                contact
                if isinstance(contact, ContactError)
                else self._pressed(contact, indenter, station, target)
                for contact, target in zip(contacts, station.targets_n, strict=True)
            ]

    def _pressed(self, contact: GelContact, indenter: Indenter, station: Station, target_n) -> PressedSkin:
        skin = skin_of(contact, self.sensor, indenter, station.x_mm, station.y_mm)
        moved_x_mm, moved_y_mm, moved_z_mm = contact.indenter_displacement_mm
        pose = {
            "x_mm": station.x_mm + moved_x_mm,
            "y_mm": station.y_mm + moved_y_mm,
            "z_mm": contact.first_touch_mm + moved_z_mm,
            "ball_mm": station.ball_mm,
            "approach_mm": -moved_z_mm,
            "contact_radius_mm": np.sqrt(skin.in_contact.sum() * self.sensor.pitch_mm**2 / np.pi),
            "grid_x_mm": station.x_mm,
            "grid_y_mm": station.y_mm,
            "load_n": station.load_n,
            "tangential_x_n": target_n[0],
            "tangential_y_n": target_n[1],
        }
        return PressedSkin(
            skin.normals, skin.depth_mm, skin.in_contact, contact.force_n, pose, skin.tangential_mm
        )
