"""Fault injection: errors as the sensor drifts or fails, and the level at which its frames are flagged."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import matplotlib
import numpy as np

from fastac.report.figures import save_png
from fastac.sensor.samples import subset

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from fastac.flow import frames
from fastac.flow.steps import virtual_presses
from fastac.models import accuracy
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.integer.bundle import Bundle
from fastac.models.integer.dot_follower import FRACTION
from fastac.models.integer.frame_validity import REASONS
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset
from fastac.sensor.optics import faults

ERRORS = {"depth_mae_mm": "depth error, mm", "force_mae_n": "force error, N"}
LOADS = (1.5, 2, 3, 4, 6)
"""Overloads in multiples of the largest load that the models were trained on."""
LIGHT_N = 0.01
"""A load far below those of the training."""
MARKED = 0.5
"""Share of flagged frames from which a level is marked in the plots."""


@dataclass(frozen=True)
class Fault:
    """A fault to inject at several levels.

    levels : in `unit`; good : the level without a fault
    apply : good frames (frames, H, W, C) and a level to faulty frames
    """

    name: str
    unit: str
    levels: tuple[float, ...]
    good: float
    apply: Callable[[np.ndarray, float], np.ndarray]


def frame_faults(scene: Scene, mean_dn: float) -> list[Fault]:
    """All faults that are injected into frames; `mean_dn` is the background's mean."""
    drift = (0, 0.01, 0.02, 0.03, 0.05, 0.1, 0.15, 0.2)
    both = (*(-x for x in reversed(drift[1:])), *drift)
    found = [
        Fault("gain", "", tuple(round(1 + x, 2) for x in both), 1, faults.gain),
        Fault("offset", "DN", tuple(round(x * mean_dn, 1) for x in both), 0, faults.offset),
    ]
    for channel, name in enumerate(scene.sensor.channel_names):
        levels = (0, 0.5, 0.8, 0.9, 0.95, 0.98, 1)
        apply = partial(_dimmed, channel)
        found.append(Fault(f"{name} light", "of its brightness", levels, 1, apply))
    percent = (0, 0.05, 0.1, 0.2, 0.5, 1, 2)
    found.append(Fault("dead pixels", "%", percent, 0, _dead))
    sigmas = (0, 0.35, 0.5, 0.7, 1, 1.5, 2, 4)
    found.append(Fault("defocus", "px, sigma", sigmas, 0, faults.defocused))
    return found


def dot_faults(pipeline: IntegerPipeline) -> list[Fault]:
    """Faults of some of the marker dots, where they have a part in the force: the levels are their numbers.

    Dots are damaged where they are found; a doubled one has a second one beside it.
    """
    if pipeline.follower is None:
        return []
    follower, dots = pipeline.follower, pipeline.scene.sensor.markers
    rest_px, count = follower.rest * 2.0**-FRACTION, len(follower.rest)
    radius_px = dots.radius_mm / pipeline.scene.sensor.pitch_mm
    order = np.random.default_rng(1).permutation(count)
    levels = tuple(level for level in (0, 1, 2, 4, 8, 16) if level <= count)

    def places(frames: np.ndarray, level: float) -> np.ndarray:
        shift, _ = follower(follower.windows(frames))
        chosen = order[: int(level)]
        return rest_px[chosen] + shift[:, chosen] * 2.0**-FRACTION

    def covered(frames: np.ndarray, level: float) -> np.ndarray:
        return faults.covered_dots(frames, places(frames, level), radius_px)

    def smeared(frames: np.ndarray, level: float) -> np.ndarray:
        return faults.smeared_dots(frames, places(frames, level), radius_px)

    def added(frames: np.ndarray, level: float) -> np.ndarray:
        beside = places(frames, level) + np.array([2 * radius_px + 1, 0])
        return faults.added_dots(frames, beside, radius_px)

    return [
        Fault(f"dots {name}", "dots", levels, 0, apply)
        for name, apply in (("covered", covered), ("smeared", smeared), ("doubled", added))
    ]


def _dimmed(channel: int, frames: np.ndarray, factor: float) -> np.ndarray:
    return faults.dimmed(frames, channel, factor)


def _dead(frames: np.ndarray, percent: float) -> np.ndarray:
    return faults.dead_pixels(frames, percent / 100)


def loads_n(scene: Scene) -> tuple[float, ...]:
    """LIGHT_N, the largest load that the models were trained on, and overloads."""
    largest = max(scene.protocol.loads_n)
    return (LIGHT_N, largest, *(largest * factor for factor in LOADS))


def presses(scene: Scene, store: Path, *, progress: bool) -> Dataset:
    """Virtual presses at each of `loads_n`, place by place."""
    protocol = scene.protocol.model_copy(
        update={"train_grid": 1, "validation_grid": 1, "test_grid": 4, "loads_n": loads_n(scene)}
    )
    pressed = virtual_presses(scene.model_copy(update={"protocol": protocol}), store, progress=progress)
    return frames.read(pressed, scene, store=store, progress=progress)


def _row(fault: str, unit: str, level: float, models: dict, data: Dataset, bundle: Bundle) -> dict:
    """A row of the table: errors of both models on all frames of `data`, how many are flagged, and why."""
    index = np.arange(len(data))
    row = {"fault": fault, "unit": unit, "level": level, "frames": len(data)}
    for name, pipeline in models.items():
        result, rest = pipeline.run(data.frames), pipeline.run(data.background[None])
        found = accuracy.evaluate(result, rest, data, index, bundle.scene)
        row[name] = {key: found[key] for key in ERRORS if key in found}
        fields = [value for value in vars(result).values() if value is not None]
        row[name]["finite"] = all(bool(np.isfinite(value).all()) for value in fields)
    # The integer model is the last: its flags are the hardware's.
    row["suspect_share"] = float((result.validity != 0).mean())
    counts = {name: int((result.validity >> k & 1).sum()) for k, name in enumerate(REASONS)}
    row["reasons"] = {name: count for name, count in counts.items() if count}
    return row


def measure(
    bundle: Bundle, data: Dataset, index: np.ndarray, store: Path, *, progress: Callable
) -> Iterator[dict]:
    """One row per fault and level, then one per load of virtual presses where the sensor is simulated.

    index : the held-out frames that the faults are injected into; progress : wraps the list of faults
    store : folder of the step store, which keeps the presses
    """
    models = {
        "float": accuracy.with_background_of(FloatPipeline.from_bundle(bundle), data),
        "integer": accuracy.with_background_of(bundle.pipeline, data),
    }
    good = subset(data, index)
    cases = frame_faults(bundle.scene, float(data.background.mean())) + dot_faults(bundle.pipeline)
    for fault in progress(cases):
        for level in fault.levels:
            changed = replace(good, frames=fault.apply(good.frames, level))
            yield _row(fault.name, fault.unit, level, models, changed, bundle)
    if bundle.scene.sensor.source == "simulated" and bundle.scene.wants_force:
        pressed = presses(bundle.scene, store, progress=False)
        loads = loads_n(bundle.scene)
        each = np.tile(np.arange(len(loads)), len(pressed) // len(loads))
        for k, load in enumerate(loads):
            yield _row("load", "N", float(load), models, subset(pressed, np.flatnonzero(each == k)), bundle)


def figure(rows: list[dict], file: Path) -> None:
    """Write a PNG, a row of plots per fault: errors of both models and share of flagged frames by level."""
    names = list(dict.fromkeys(row["fault"] for row in rows))
    kinds = [key for key in ERRORS if any(key in row["integer"] for row in rows)]
    plot, axes = plt.subplots(
        len(names), max(len(kinds), 1), figsize=(6 * max(len(kinds), 1), 2.6 * len(names)), squeeze=False
    )
    for name, line in zip(names, axes, strict=True):
        chosen = [row for row in rows if row["fault"] == name]
        levels = [row["level"] for row in chosen]
        for key, axis in zip(kinds, line, strict=False):
            for model, style in (("float", "C0--"), ("integer", "C3-")):
                axis.plot(levels, [row[model].get(key) for row in chosen], style, label=model, lw=1.2)
            axis.set(xlabel=f"{name} {chosen[0]['unit']}".strip(), ylabel=ERRORS[key], yscale="log")
            for row in chosen:
                if row["suspect_share"] >= MARKED:
                    axis.plot(row["level"], row["integer"].get(key), "kx", ms=6)
            share = axis.twinx()
            share.fill_between(levels, [100 * row["suspect_share"] for row in chosen], color="0.5", alpha=0.2)
            share.set(ylim=(0, 102), ylabel="flagged, %")
        line[0].legend(loc="best", fontsize=7)
    plot.suptitle("Errors of held-out frames; crosses: half of the frames or more are flagged as suspect")
    plot.tight_layout(rect=(0, 0, 1, 0.99))
    save_png(plot, file)
