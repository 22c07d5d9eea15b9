"""Indenters of random shape: balls, cylinders, edges, round punches and lumps."""

from collections.abc import Callable

import numpy as np

from fastac.sensor.mechanics.indenter import Ball, Cylinder, Edge, FlatPunch, HeightMap, Indenter
from fastac.sensor.protocol import Station

LUMP_PITCH_MM = 0.1


def lump(rng: np.random.Generator) -> HeightMap:
    """A bowl with waves on it, 8 mm wide."""
    x, y = np.meshgrid(*(np.arange(-4, 4 + LUMP_PITCH_MM / 2, LUMP_PITCH_MM),) * 2)
    height = x**2 / (2 * rng.uniform(2, 8)) + y**2 / (2 * rng.uniform(2, 8))
    angle, phase = rng.uniform(0, 2 * np.pi, 2)
    along = np.cos(angle) * x + np.sin(angle) * y
    waves = rng.uniform(0.02, 0.1) * np.cos(2 * np.pi * along / rng.uniform(1.5, 4) + phase)
    return HeightMap(height + waves, LUMP_PITCH_MM)


KINDS: dict[str, Callable[[np.random.Generator], Indenter]] = {
    "ball": lambda rng: Ball(rng.uniform(3, 8)),
    "cylinder": lambda rng: Cylinder(rng.uniform(3, 8), rng.uniform(3, 8), rng.uniform(0, 180)),
    "edge": lambda rng: Edge(
        rng.uniform(3, 7), rng.uniform(90, 150), rng.uniform(0.2, 0.6), rng.uniform(0, 180)
    ),
    "punch": lambda rng: FlatPunch(rng.uniform(2, 5)),
    "lump": lump,
}
"""Makers of a random indenter, by kind."""


def indenter_of(station: Station) -> Indenter:
    """What presses at a station: its ball, or an object of its shape whose size follows from its draw."""
    if station.shape == "ball":
        return Ball(station.ball_mm)
    return KINDS[station.shape](np.random.default_rng(station.draw))
