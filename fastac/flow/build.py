"""The main job: from a scene to trained integers, Verilog, its proof on real frames, and the report."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from fastac.flow import frames, steps
from fastac.gateware.target.device import DeviceError
from fastac.models.integer import bundle
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset
from fastac.store.files import write_json
from fastac.store.record import RECORD, described, read_record
from fastac.store.steps import Output, Step
from fastac.store.store import open_store
from fastac.synth import fits, synthesis, vivado_reports


class BuildError(ValueError):
    """A build that cannot start; the message is one line."""


@dataclass
class Build:
    """The steps of one scene's build. Results are kept in the store and placed in `folder`.

    data_file : recorded frames; without it the virtual fingertip is pressed
    """

    scene: Scene
    folder: Path
    data_file: Path | None = None
    progress: bool = True

    def __post_init__(self):
        if self.scene.sensor.source == "recorded" and self.data_file is None:
            raise BuildError(
                f"scene {self.scene.name}: sensor.source = 'recorded': give the recording with --data FILE"
            )
        self._check(fits.check_products)
        self.folder.mkdir(parents=True, exist_ok=True)

    def _check(self, fit: Callable[[Scene], None]) -> None:
        """Raise BuildError where the scene's hardware does not fit its part."""
        try:
            fit(self.scene)
        except DeviceError as error:
            raise BuildError(f"scene {self.scene.name}: {error}") from None

    @property
    def store(self) -> Path:
        """The folder of the step store, which builds beside this one share."""
        return self.folder.parent / "store"

    @property
    def data_path(self) -> Path:
        return self.data_file or self.folder / steps.DATA

    @cached_property
    def data(self) -> Dataset:
        """The frames, once the step `data` has been performed."""
        return frames.read(self.data_path, self.scene, store=self.store, progress=self.progress)

    @cached_property
    def bundle(self) -> bundle.Bundle:
        return bundle.load(self.folder / steps.BUNDLE)

    @cached_property
    def steps(self) -> dict[str, Step]:
        """By name, each after those that it needs; no more than what the scene wants."""
        scene, found = self.scene, {}
        quiet = {"store": self.store, "progress": self.progress}

        def add(
            name: str, function: Callable, arguments: dict, *outputs: str, unkeyed: dict = quiet
        ) -> Output:
            found[name] = Step(name, function, arguments, outputs, unkeyed)
            return found[name].output(outputs[0])

        data = self.data_file or add("data", steps.data, {"scene": scene}, steps.DATA)
        known = {"scene": scene, "data": data}
        weights = {"weights": add("normals", steps.normals, known, steps.NORMALS)}
        weights |= {"integers": add("integers", steps.integers, known | weights, steps.INTEGERS)}
        force = add("force", steps.force, known | weights, steps.FORCE) if scene.wants_force else None
        trained = known | weights | {"force": force}
        if scene.wants_interval:
            trained |= {"left_out": add("left_out_groups", steps.left_out, known, steps.LEFT_OUT)}
        model = {"scene": scene, "bundle": add("bundle", steps.bundle, trained, steps.BUNDLE)}
        seen = model | {"data": data}
        accuracy = add("evaluate", steps.evaluate, seen, steps.ACCURACY)
        shown = {"progress": self.progress}
        verilog = add("verilog", steps.verilog, model, steps.VERILOG, unkeyed=shown)
        count = {"count": scene.simulation.frames}
        simulation = add(
            "sim",
            steps.simulate,
            seen | {"verilog": verilog} | count,
            steps.SIMULATION,
            unkeyed=quiet | {"workplace": self.folder / "sim"},
        )
        synthesised = self.folder / synthesis.FILE
        reported = {"accuracy": accuracy, "verilog": verilog, "simulation": simulation}
        reported["synthesis_file"] = synthesised if synthesised.exists() else None
        vivado = self.folder / vivado_reports.FILE
        reported["vivado_file"] = vivado if vivado.exists() else None
        stored = {"store": self.store}
        add("report", steps.report, seen | reported, steps.REPORT, steps.PAGE, unkeyed=stored)
        return found

    def reasons(self) -> dict[str, str]:
        """Of each step "current", or the first thing that changed since it ran; performs nothing."""
        store = open_store(self.store)
        return {name: store.why(step) for name, step in self.steps.items()}

    def run(self, announce: Callable[[str, str], None], *, until: str | None = None) -> None:
        """Perform the steps in order, those that are up to date excepted; `until` names the last one.

        Raises BuildError before anything is trained where, as far as can be known without training, the
        hardware does not fit the scene's part.

        announce : called with a step's name and "kept", "running" or, for another process, "waiting"
        """
        store, record, performed = open_store(self.store), read_record(self.folder), {}
        if not store.is_current(self.steps["bundle"]):
            self._check(fits.check_scene)
        for name, step in self.steps.items():
            entry = store.perform(step, announce, performed)
            entry.place(self.folder)
            if record.get(name) != (found := described(entry)):
                record[name] = found
                write_json(self.folder / RECORD, record)
            if name == until:
                return
