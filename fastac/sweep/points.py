"""The models behind a sweep's points: each training once for all points that share it, each point measured.

A step's key is a hash of all that it depends on: settings, code, the steps before it. Its result is the file
of that name in the cache, whole or not there at all, so any number of workers may share a cache: one trains,
the others wait for it.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from pathlib import Path

import numpy as np
import torch
from filelock import FileLock

from fastac.flow import training
from fastac.gateware.cycle_model import cycles, multipliers
from fastac.gateware.target.device import check_block_rams, check_multipliers
from fastac.models import accuracy
from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.hyperforce import HyperForce
from fastac.models.integer import assemble
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.training import hyperforce
from fastac.scenes.schema import Scene
from fastac.scenes.sensor_schema import Sensor
from fastac.sensor import dataset, fingertip, samples
from fastac.store.files import digest_file, load_arrays, save_arrays, write_json
from fastac.store.sources import TRAINING_SOURCES, digest_sources
from fastac.sweep.spec import digest
from fastac.synth import energy, resources

POINT_SOURCES = (
    "models/**/*.py",
    "gateware/**/*.py",
    "fastac/sweep/points.py",
    "fastac/synth/energy.py",
    "fastac/synth/resource*",
)
START = "start."
"""Prefix of the force model's parameters in the cache."""


@cache
def sources(patterns: tuple[str, ...]) -> str:
    return digest_sources(patterns)


@cache
def digest_data(path: Path) -> str:
    return digest_file(path)


@lru_cache(maxsize=2)
def _read(path: Path, sensor: Sensor) -> dataset.Dataset:
    """The dataset, which must be one of the sensor."""
    return dataset.read(path, Scene(name="sweep", outputs=("normals",), sensor=sensor))


@dataclass(frozen=True)
class Step:
    """One training that points share: its key, the steps before it, and what writes its file."""

    name: str
    key: str
    path: Path
    needs: tuple["Step", ...]
    run: Callable[[Path], None]

    def perform(self) -> None:
        """Write the file unless it is there; another process that is at it is waited for."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        # The lock belongs to the process: if that dies the system releases it.
        with FileLock(self.path.with_suffix(".lock")):
            if not self.path.exists():
                self.run(self.path)


@dataclass(frozen=True)
class Setting:
    """What all points of a sweep have in common: where data and models are, which frames are evaluated."""

    cache: str
    data: str | None
    split: str
    frames: int


@dataclass(frozen=True)
class PointModels:
    """The steps and the figures of one scene."""

    scene: Scene
    setting: Setting

    @property
    def data_path(self) -> Path:
        return self.steps["data"].path if self.setting.data is None else Path(self.setting.data)

    @cached_property
    def data(self) -> dataset.Dataset:
        found = _read(self.data_path, self.scene.sensor)
        training.require(found, self.scene, self.data_path)
        return found

    @cached_property
    def index(self) -> np.ndarray:
        """The frames that are evaluated."""
        chosen = samples.split_indices(self.data, self.setting.split, self.data_path)
        return samples.evenly_spaced(chosen, self.setting.frames)

    @cached_property
    def steps(self) -> dict[str, Step]:
        """By name, each after those that it needs; no more than what the scene wants."""
        scene = self.scene
        content = scene.model_dump(mode="json")
        labels = scene.training.labels
        found: dict[str, Step] = {}

        def add(name: str, settings: dict, run, needs: tuple[str, ...] = (), suffix: str = ".npz") -> None:
            before = tuple(found[need] for need in needs if need in found)
            of_data = None if self.setting.data is None else digest_data(Path(self.setting.data))
            code = sources(("sensor/**/*.py",) if name == "data" else TRAINING_SOURCES)
            key = digest([name, settings, code, of_data, [step.key for step in before]])
            path = Path(self.setting.cache) / name / f"{key}{suffix}"
            found[name] = Step(name, key, path, before, run)

        def chosen(group: str, *prefixes: str) -> dict:
            return {k: v for k, v in content[group].items() if k.startswith(prefixes)}

        sensor = {"sensor": content["sensor"]}
        if self.setting.data is None:
            add("data", sensor | {"protocol": content["protocol"]}, self._generate, suffix=".h5")
        taught = ("seed", "normals", "teacher", "input", "position", "flat", "labels")
        learned = {"network": content["network"], "training": chosen("training", *taught)}
        if labels == "force":
            learned |= {name: content[name] for name in ("outputs", "training", "numbers")}
        add("normals", sensor | learned, self._normals, ("data",))
        bits = chosen("numbers", "weight_bits", "activation_bits", "last_weight_bits")
        tuned = {"numbers": bits, "training": chosen("training", "finetune")}
        add("integers", tuned, self._integers, ("data", "normals"))
        slopes = {
            "limit": scene.numbers.slope_limit,
            "divergence": scene.poisson.divergence,
            "adjoint": scene.force_from_slopes,
        }
        measured = ["data", "normals"]
        if scene.wants_force:
            shape = chosen("force", "kernel_size", "clamp", "fit", "hidden")
            taught = slopes | {
                "axes": scene.force_axes,
                "force": shape,
                "training": chosen("training", "force"),
            }
            add("force", taught, self._force, ("data", "normals"))
            measured.append("force")
        outputs = {"outputs": content["outputs"], "mode": scene.poisson.mode, "clamp": scene.force.clamp}
        frames = {"split": self.setting.split, "frames": self.setting.frames}
        add("float", slopes | outputs | frames, self._float, tuple(measured), ".json")
        return found

    def _arrays(self, name: str) -> dict[str, np.ndarray]:
        return load_arrays(self.steps[name].path)

    def _generate(self, output: Path) -> None:
        """With everything that any point might want: they all learn from the same presses."""
        fingertip.generate(self.scene.model_copy(update={"outputs": ("depth",)}), output, progress=False)

    def _normals(self, output: Path) -> None:
        training.normals(self.data, self.scene, output, progress=False)

    def _integers(self, output: Path) -> None:
        training.integers(self.data, self.scene, self.steps["normals"].path, output, progress=False)

    def _force(self, output: Path) -> None:
        start, arrays = training.start_force(self.data, self.scene, self._arrays("normals"), progress=False)
        if start is not None:
            arrays |= {START + name: value.numpy() for name, value in start.state_dict().items()}
        save_arrays(output, arrays)

    def _float(self, output: Path) -> None:
        arrays = self._arrays("normals") | (self._arrays("force") if self.scene.wants_force else {})
        write_json(output, self._errors(training.float_pipeline(arrays, self.data, self.scene)))

    def _start(self, arrays: dict[str, np.ndarray]) -> HyperForce | None:
        """The trained force model that fits begin from; none where the slopes' weights are fitted."""
        state = {k.removeprefix(START): torch.from_numpy(v) for k, v in arrays.items() if k.startswith(START)}
        if not state:
            return None
        rest = training.rest_depth_mm(self.data)
        model = hyperforce.build(self.scene, rest, axes=len(self.scene.force_axes))
        model.load_state_dict(state)
        return model

    def _errors(self, pipeline) -> dict[str, float]:
        result, rest = pipeline.run(self.data.frames[self.index]), pipeline.run(self.data.background[None])
        return accuracy.evaluate(result, rest, self.data, self.index, self.scene)

    @cached_property
    def pipeline(self) -> IntegerPipeline:
        """The integers, as `fastac train` would find them; all steps must have been performed."""
        pipeline = training.integer_pipeline(self._arrays("integers"), self.data, self.scene)
        if not self.scene.wants_force:
            return pipeline
        start = self._start(self._arrays("force"))
        fitted = training.fit_force("integer", Emulator(pipeline), self.data, start, progress=False)
        return assemble.with_force(pipeline, fitted["force.integer_weights"].astype(np.float64))

    @cached_property
    def floats(self) -> dict[str, np.ndarray]:
        """The float models' arrays, for a bundle."""
        arrays = self._arrays("normals") | (self._arrays("force") if self.scene.wants_force else {})
        return {name: value for name, value in arrays.items() if not name.startswith(START)}

    def metrics(self) -> dict[str, float]:
        """Errors of the integers and, as float_…, of the float models; cycles, resources, energy.

        Raises DeviceError, or ValueError where a word cannot hold its worst case.
        """
        check_multipliers(multipliers(self.scene))
        pipeline = self.pipeline
        check_block_rams(resources.block_rams(resources.memories(pipeline)))
        found = self._errors(Emulator(pipeline))
        floats = json.loads(self.steps["float"].path.read_text())
        found |= {f"float_{name}": value for name, value in floats.items()}
        for prefix in ("", "float_"):
            if len(self.scene.force_axes) == 1:  # to stand beside the same axis of a force of three
                found[f"{prefix}force_{'xyz'[self.scene.force_axes[0]]}_mae_n"] = found[
                    f"{prefix}force_mae_n"
                ]
        found |= latency(self.scene, flat=not pipeline.rest_depth_mm.any())
        estimated = resources.estimate(pipeline)
        found |= {name: estimated[key]["value"] for name, key in RESOURCES.items()}
        energy_uj = energy.estimate(pipeline)["energy_estimate_uj_per_frame"]["value"]
        return found | {"energy_uj": energy_uj}


RESOURCES = {"dsp": "dsp48e2", "lut": "lut", "ramb36": "ramb36"}
"""Metrics by the name that the report has for them."""


def latency(scene: Scene, *, flat: bool) -> dict[str, float]:
    """Cycles from a frame's first pixel to the last thing wanted, and between frames; µs at the clock."""
    found = cycles(scene, flat=flat)
    whole = max(value for name, value in found.items() if name.startswith("first_pixel"))
    kept = {"latency_cycles": whole, "interval_cycles": found["initiation_interval"]}
    if scene.wants_force:
        kept["last_pixel_to_force_cycles"] = found["last_pixel_to_force"]
    return kept | {"latency_us": whole / scene.hardware.clock_mhz}


def origins() -> dict[str, str]:
    """Where the metrics that are no measurements of errors come from."""
    found = {name: resources.model()[1][key] for name, key in RESOURCES.items()}
    found["energy_uj"] = energy.ORIGIN
    for name in ("latency_cycles", "interval_cycles", "last_pixel_to_force_cycles"):
        found[name] = "formulas of the design (gateware/cycle_model.py), which simulations of the RTL confirm"
    return found | {"latency_us": "latency_cycles / the scene's assumed clock"}


def generation(setting: Setting) -> str:
    """What all comparable points share: the code, the data, the frames."""
    data = None if setting.data is None else digest_data(Path(setting.data))
    code = sources((*POINT_SOURCES, *TRAINING_SOURCES, "sensor/**/*.py"))
    return digest([code, data, setting.split, setting.frames])


def point_key(content: dict, setting: Setting) -> str:
    """Of a point: what it is, and its generation."""
    return digest([content, generation(setting)])
