# amaranth: UnusedElaboratable=no
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from fastac.gateware.bus.register_map import REGISTERS
from fastac.gateware.target.elaboration import to_verilog
from fastac.gateware.top_zynq import TopZynq
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer.bundle import Bundle
from fastac.models.random_bundle import frames, random_bundle, scene
from fastac.models.result import Result
from fastac.sim.independent import icarus, stimulus
from fastac.sim.independent.stimulus import Stimulus

ADDRESS = {register.name: register.offset for register in REGISTERS}


@dataclass
class Design:
    """A small design, four frames, and what the integers find in them."""

    bundle: Bundle
    verilog: str
    frames: np.ndarray
    result: Result
    latency: int

    def write(self, folder: Path, **settings) -> Stimulus:
        """The files of a bench in `folder`; `settings` may say frames and result."""
        given = {"frames": self.frames, "result": self.result} | settings
        images, result = given.pop("frames"), given.pop("result")
        return stimulus.write(
            folder, self.bundle, images, result, ADDRESS, latency=self.latency, **({"clean": 2} | given)
        )

    def source(self, folder: Path, text: str | None = None) -> Path:
        """A file with the Verilog, or with `text` instead."""
        file = folder / "fastac.v"
        file.write_text(text or self.verilog)
        return file


def small_design(folder: Path, **wanted) -> Design:
    bundle = random_bundle(folder, scene(**wanted))
    top = TopZynq(bundle)
    images = frames(bundle.pipeline.background, (10, 40, 255, 20))
    result = Emulator(bundle.pipeline).run(images)
    text = to_verilog(top, name="fastac")
    return Design(bundle, text, images, result, top.datapath.first_pixel_to_force)


@pytest.fixture(scope="session")
def slopes_design(tmp_path_factory) -> Design:
    """Normals and three forces from slopes, two pixels a clock."""
    return small_design(
        tmp_path_factory.mktemp("slopes"),
        outputs=("normals", "force_xyz"),
        solver="adjoint",
        kernel="collapsed",
        lanes=2,
    )


@pytest.fixture(scope="session")
def depth_design(tmp_path_factory) -> Design:
    """Depth, last row first, force map and force, one pixel a clock."""
    outputs = ("depth", "force_map", "force_z")
    return small_design(tmp_path_factory.mktemp("depth"), outputs=outputs, solver="tridiagonal")


@pytest.fixture
def icarus_verilog():
    if not icarus.installed():
        pytest.skip("iverilog is not installed: apt-get install iverilog")
