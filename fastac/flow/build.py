"""The main job: from a scene to trained integers, Verilog, its proof on real frames, and the report."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from fastac.flow import frames, hardware, training
from fastac.gateware.cycle_model import multipliers
from fastac.gateware.target.device import DeviceError, check_block_rams, check_multipliers
from fastac.models import accuracy
from fastac.models.integer import bundle
from fastac.report import page as reporting
from fastac.scenes.schema import Scene
from fastac.sensor import dataset, fingertip, samples
from fastac.store.files import digest_file, write_json
from fastac.store.sources import HARDWARE_SOURCES, TRAINING_SOURCES
from fastac.store.steps import Step, Workspace
from fastac.synth import resources, synthesis


class BuildError(ValueError):
    """A build that cannot start; the message is one line."""


def settings(scene: Scene, *names: str) -> dict:
    """The parts of a scene with these names, besides what any step depends on, as JSON."""
    content = scene.model_dump(mode="json")
    return {name: content[name] for name in ("outputs", "sensor", *names)}


def network_settings(scene: Scene) -> dict:
    """What of a scene its float pixel network depends on, as JSON."""
    return settings(scene, "network", "training", *(("numbers",) if scene.training.labels == "force" else ()))


def float_settings(scene: Scene) -> dict:
    """What of a scene the results of its float pipeline and force models depend on, as JSON."""
    parts = network_settings(scene) | settings(scene, "poisson", "force")
    return parts | {"slope_limit": scene.numbers.slope_limit}


@dataclass
class Build:
    """The steps of one scene's build, all files in `folder`."""

    scene: Scene
    folder: Path
    data_file: Path | None = None
    progress: bool = True

    def __post_init__(self):
        if self.scene.sensor.source == "recorded" and self.data_file is None:
            raise BuildError(
                f"scene {self.scene.name}: sensor.source = 'recorded': give the recording with --data FILE"
            )
        try:
            check_multipliers(multipliers(self.scene))
            check_block_rams(resources.block_rams(resources.kernel_memory(self.scene)))
        except DeviceError as error:
            raise BuildError(f"scene {self.scene.name}: {error}") from None
        self.folder.mkdir(parents=True, exist_ok=True)

    @property
    def data_path(self) -> Path:
        return self.data_file or self.folder / "data.h5"

    @cached_property
    def data(self) -> dataset.Dataset:
        return frames.read(self.data_path, self.scene, cache=self.cache, progress=self.progress)

    @property
    def cache(self) -> Path:
        """What builds share: compliances, processed frames."""
        return self.folder.parent / "cache"

    @cached_property
    def bundle(self) -> bundle.Bundle:
        return bundle.load(self.folder / "bundle")

    def _generate(self) -> None:
        if self.data_file is None:
            fingertip.generate(self.scene, self.data_path, cache=self.cache, progress=self.progress)
        training.require(self.data, self.scene, self.data_path)

    def _assemble(self) -> None:
        training.assemble(self.data, self.scene, self.folder, self.folder / "bundle")

    def _evaluate(self) -> None:
        index = samples.split_indices(self.data, "test", self.data_path)
        errors, _ = accuracy.compare_pipelines(self.bundle, self.data, index, progress=self.progress)
        write_json(self.folder / "accuracy.json", {"split": "test", "frames": len(index), **errors})

    def _simulate(self) -> None:
        index = samples.evenly_spaced(self.data.indices("test"), self.scene.simulation.frames)
        found = hardware.simulate(
            self.bundle,
            self.data,
            index,
            self.folder / "verilog",
            self.folder / "sim",
            progress=self.progress,
        )
        write_json(self.folder / "sim.json", {"frame_indices": index.tolist(), **found})

    def _report(self) -> None:
        reporting.write(self.folder, self.bundle, self.data)

    def steps(self) -> list[Step]:
        scene, folder, progress = self.scene, self.folder, self.progress
        source = settings(scene, "protocol")
        if self.data_file is not None:  # what it must hold depends on the scene
            source = settings(scene) | {"file": digest_file(self.data_file)}
        source |= {"tangential": scene.tangential_shares}
        source |= {"depth": scene.wants_solver, "rest": scene.wants_slopes, "labels": scene.training.labels}
        weights, integers = folder / "normals.npz", folder / "integers.npz"
        steps = [
            Step(
                "data",
                self._generate,
                source,
                ("sensor/**/*.py",),
                () if self.data_file else ("data.h5",),
            ),
            Step(
                "normals",
                lambda: training.normals(self.data, scene, weights, progress=progress),
                network_settings(scene),
                TRAINING_SOURCES,
                ("normals.npz",),
                ("data",),
            ),
            Step(
                "integers",
                lambda: training.integers(self.data, scene, weights, integers, progress=progress),
                settings(scene, "network", "training", "numbers"),
                TRAINING_SOURCES,
                ("integers.npz",),
                ("normals",),
            ),
        ]
        if scene.wants_force:
            steps.append(
                Step(
                    "force",
                    lambda: training.force(
                        self.data, scene, weights, integers, folder / "force.npz", progress=progress
                    ),
                    settings(scene, "training", "numbers", "poisson", "force"),
                    TRAINING_SOURCES,
                    ("force.npz",),
                    ("integers",),
                )
            )
        trained = ("force",) if scene.wants_force else ("integers",)
        return [
            *steps,
            Step(
                "bundle",
                self._assemble,
                scene.model_dump(mode="json"),
                TRAINING_SOURCES,
                ("bundle",),
                trained,
            ),
            Step(
                "evaluate",
                self._evaluate,
                None,
                ("models/**/*.py", "fastac/accuracy.py"),
                ("accuracy.json",),
                ("bundle",),
            ),
            Step(
                "verilog",
                lambda: hardware.write_verilog(self.bundle, folder / "verilog", progress=progress),
                None,
                HARDWARE_SOURCES,
                ("verilog",),
                ("bundle",),
            ),
            Step(
                "sim",
                self._simulate,
                None,
                (*HARDWARE_SOURCES, "sim/**/*.py"),
                ("sim.json",),
                ("verilog",),
            ),
            Step(
                "report",
                self._report,
                digest_file(folder / synthesis.FILE) if (folder / synthesis.FILE).exists() else None,
                (
                    "fastac/report/*.py",
                    "fastac/report/page.html.j2",
                    "fastac/synth/energy.py",
                    "fastac/report/paper.py",
                ),
                ("report.json", "report.html"),
                ("evaluate", "sim"),
            ),
        ]

    def run(self, announce: Callable[[str, bool], None], *, until: str | None = None) -> None:
        """Perform the steps in order, those that are up to date excepted; `until` names the last one."""
        workspace = Workspace(self.folder)
        for step in self.steps():
            workspace.perform(step, announce)
            if step.name == until:
                return
