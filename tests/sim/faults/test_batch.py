"""Faults played to hardware, whole and broken on purpose."""

import pytest
from amaranth import Signal
from fastac.gateware.bus.registers import RegisterBlock
from fastac.gateware.stream import raster_port
from fastac.gateware.stream.frame_guard import FrameGuard
from fastac.gateware.stream.raster_port import RasterPort
from fastac.sim.faults.batch import FaultFound, numbers_of, play, spans
from fastac.sim.faults.designs import FLOPS, OTHER, OWN, SOURCE, elaborate
from fastac.sim.faults.generator import faults, goal_of
from fastac.sim.faults.golden import Hardware
from fastac.sim.faults.script import Fault, Script
from fastac.sim.runner import QUICK

DESIGN = "normals_4"


class Played:
    """A design's hardware as it is now, and faults through it."""

    def __init__(self, folder, design=DESIGN):
        self.folder, self.design = folder, design
        elaborate(folder, design)
        self.hardware = Hardware.load(folder / OWN, folder / OTHER)

    def play(self, chosen: list[Fault]) -> list[dict]:
        flops = self.folder / FLOPS
        return play(
            self.hardware, self.folder / SOURCE, flops, chosen, 1, self.folder / "sim", build_args=QUICK
        )

    def of(self, *goals: tuple[str, str]) -> list[Fault]:
        """The first fault of each of these kinds and states."""
        shape = self.hardware.shape
        numbers = {goal_of(shape, self.design, 1, number): number for number in range(300, -1, -1)}
        return faults(shape, self.design, 1, [numbers[goal] for goal in goals])
