"""Float and integer models on the same frames, against ground truth."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from fastac.models import accuracy
from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.integer.bundle import Bundle
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.result import Result
from fastac.sensor.dataset import Dataset, DatasetError


def choose(data: Dataset, split: str, path: Path) -> np.ndarray:
    """Frames of a split, or "all"; raises DatasetError where there are none."""
    index = np.arange(len(data)) if split == "all" else data.indices(split)
    if not len(index):
        raise DatasetError(f"{path}: split: no frame is in {split!r}")
    return index


def spread(index: np.ndarray, count: int) -> np.ndarray:
    """`count` frames spread evenly over `index` (all of it if it is smaller)."""
    return index[np.unique(np.linspace(0, len(index) - 1, count).round().astype(int))]


def of_dataset(pipeline, data: Dataset):
    """What runs frames with the dataset's own background: each recording is seen against its own rest.

    pipeline : a float pipeline, or the tables of an integer one
    """
    own = replace(pipeline, background=data.background)
    return Emulator(own) if isinstance(own, IntegerPipeline) else own


def compare(
    bundle: Bundle, data: Dataset, index: np.ndarray, *, progress: bool
) -> tuple[dict, dict[str, Result]]:
    """Errors of both pipelines on frames `index`; returns {"float": …, "integer": …} and the results.

    "growth_percent" says by how much each error grows from float to integer.
    """
    pipelines = {
        "float": of_dataset(FloatPipeline.from_bundle(bundle), data),
        "integer": of_dataset(bundle.pipeline, data),
    }
    results = {name: p.run(data.frames[index], progress=progress) for name, p in pipelines.items()}
    errors = {
        name: accuracy.evaluate(result, pipelines[name].run(data.background[None]), data, index, bundle.scene)
        for name, result in results.items()
    }
    growth = {
        key: 100 * (errors["integer"][key] / value - 1)
        for key, value in errors["float"].items()
        if value and "_r2" not in key
    }
    saturated = {
        key: int(getattr(results["integer"], key).sum())
        for key in ("gradient_saturated", "displacement_saturated")
        if getattr(results["integer"], key) is not None
    }
    return {**errors, "growth_percent": growth, "saturated_values": saturated}, results
