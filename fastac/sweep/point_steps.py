"""Steps that only a sweep has: force models to start from, errors of the float models, a point's figures."""

from pathlib import Path

import numpy as np
import torch

from fastac.flow import force_training
from fastac.flow.pipelines import float_pipeline, integer_pipeline, rest_depth_mm, with_fitted_force
from fastac.flow.steps import training_data
from fastac.gateware.cycle_model import cycles
from fastac.gateware.target.device import device_of
from fastac.models import accuracy
from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.hyperforce import HyperForce
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.training.force import hyperforce
from fastac.scenes.schema import Scene
from fastac.sensor import samples
from fastac.sensor.dataset import Dataset
from fastac.store.files import load_arrays, read_json, save_arrays, write_json
from fastac.synth import fits
from fastac.synth.estimates import energy, resources

START_FILE, FLOAT_FILE = "force_start.npz", "float_errors.json"
START = "start."
"""Prefix of the force model's parameters in START_FILE."""


def force_start(folder: Path, scene: Scene, data: Path, weights: Path, *, store: Path) -> None:
    """The force model that every pipeline's fit starts from, and its fit to the float pipeline."""
    known = training_data(data, scene, store)
    start, arrays = force_training.start_force(known, scene, load_arrays(weights), progress=False)
    if start is not None:
        arrays |= {START + name: value.numpy() for name, value in start.state_dict().items()}
    save_arrays(folder / START_FILE, arrays)


def float_errors(
    folder: Path,
    scene: Scene,
    data: Path,
    weights: Path,
    force: Path | None,
    split: str,
    count: int,
    *,
    store: Path,
) -> None:
    """Errors of the float models on `count` frames, spread evenly over a split."""
    known, arrays = training_data(data, scene, store), float_arrays(weights, force)
    pipeline = float_pipeline(arrays, known, scene)
    write_json(folder / FLOAT_FILE, errors(pipeline, known, evaluated(known, split, count, data), scene))


def measure(
    folder: Path,
    scene: Scene,
    data: Path,
    integers: Path,
    force: Path | None,
    floats: Path,
    split: str,
    count: int,
    *,
    store: Path,
) -> dict[str, float]:
    """Errors of the integers and, as float_…, of the float models; cycles, resources, energy.

    Raises DeviceError, or ValueError where a word cannot hold its worst case.
    """
    fits.check_products(scene)
    known = training_data(data, scene, store)
    pipeline = integer_model(known, scene, integers, force)
    fits.area(pipeline).check()
    found = errors(Emulator(pipeline), known, evaluated(known, split, count, data), scene)
    found |= {f"float_{name}": value for name, value in read_json(floats).items()}
    for prefix in ("", "float_"):
        if len(scene.force_axes) == 1:  # to stand beside the same axis of a force of three
            axis = "xyz"[scene.force_axes[0]]
            found[f"{prefix}force_{axis}_mae_n"] = found[f"{prefix}force_mae_n"]
    found |= latency(pipeline)
    estimated = resources.estimate(pipeline)
    names = RESOURCES | {"dsp": device_of(scene).dsp_key}
    found |= {name: estimated[key]["value"] for name, key in names.items()}
    return found | {"energy_uj": energy.estimate(pipeline)["energy_estimate_uj_per_frame"]["value"]}


def evaluated(data: Dataset, split: str, count: int, path: Path) -> np.ndarray:
    """The frames that a point is judged by."""
    return samples.evenly_spaced(samples.split_indices(data, split, path), count)


def float_arrays(weights: Path, force: Path | None) -> dict[str, np.ndarray]:
    """The float models' arrays, as a bundle has them."""
    arrays = load_arrays(weights) | (load_arrays(force) if force else {})
    return {name: value for name, value in arrays.items() if not name.startswith(START)}


def integer_model(data: Dataset, scene: Scene, integers: Path, force: Path | None) -> IntegerPipeline:
    """The integers, as `fastac train` would find them."""
    pipeline = integer_pipeline(load_arrays(integers), data, scene)
    if force is None:
        return pipeline
    start = _start(load_arrays(force), data, scene)
    fitted = force_training.fit_force("integer", Emulator(pipeline), data, start, progress=False)
    return with_fitted_force(pipeline, fitted)


def _start(arrays: dict[str, np.ndarray], data: Dataset, scene: Scene) -> HyperForce | None:
    """The trained force model that fits begin from; none where the slopes' weights are fitted."""
    state = {k.removeprefix(START): torch.from_numpy(v) for k, v in arrays.items() if k.startswith(START)}
    if not state:
        return None
    model = hyperforce.build(scene, rest_depth_mm(data), axes=len(scene.force_axes))
    model.load_state_dict(state)
    return model


def errors(pipeline, data: Dataset, index: np.ndarray, scene: Scene) -> dict[str, float]:
    result, rest = pipeline.run(data.frames[index]), pipeline.run(data.background[None])
    return accuracy.evaluate(result, rest, data, index, scene)


RESOURCES = {"dsp": "dsp48e2", "lut": "lut", "ramb36": "ramb36"}
"""Metrics by the name that the report has for them; "dsp" on a part with DSP48E1 by their name."""


def cycles_of(pipeline: IntegerPipeline) -> dict:
    """Clock cycles of the pipeline's hardware by formula, see `cycle_model.cycles`."""
    return cycles(
        pipeline.scene,
        hidden=pipeline.hidden,
        flat=not pipeline.rest_depth_mm.any(),
        follower=pipeline.follower,
    )


def latency(pipeline: IntegerPipeline) -> dict[str, float]:
    """Cycles from a frame's first pixel to the last thing wanted, and between frames; µs at the clock."""
    scene, found = pipeline.scene, cycles_of(pipeline)
    whole = max(value for name, value in found.items() if name.startswith("first_pixel"))
    kept = {"latency_cycles": whole, "interval_cycles": found["initiation_interval"]}
    if scene.wants_force:
        kept["last_pixel_to_force_cycles"] = found["last_pixel_to_force"]
    return kept | {"latency_us": whole / scene.hardware.clock_mhz}


def origins() -> dict[str, str]:
    """Where the metrics that are no measurements of errors come from."""
    _, stated = resources.model(is_folded=True)
    found = {name: stated[key] for name, key in RESOURCES.items()}
    found["energy_uj"] = energy.ORIGIN
    for name in ("latency_cycles", "interval_cycles", "last_pixel_to_force_cycles"):
        found[name] = "formulas of the design (gateware/cycle_model.py), which simulations of the RTL confirm"
    return found | {"latency_us": "latency_cycles / the scene's assumed clock"}
