"""The newtons of one unit of the hardware's force, fitted to presses of another unit of the sensor.

The force's weights are in the hardware, but what one unit of a sum means is the host's business, so that the
stiffness of another gel takes one factor an axis.
"""

from dataclasses import replace

import numpy as np

from fastac.flow.few_presses import presses
from fastac.models.emulator.pipeline import Emulator
from fastac.models.floating.pipeline import FloatPipeline
from fastac.models.integer.bundle import Bundle
from fastac.sensor.dataset import Dataset

FEWEST_PRESSES = 3
"""Presses with forces from which on the scale is fitted."""


def with_force_scale(made: Bundle, data: Dataset, index: np.ndarray) -> tuple[Bundle, str]:
    """The bundle with the force's newtons per unit fitted to the frames `index`, and a line about it.

    The factors are kept where they lower the mean error of presses that they were not fitted to, each held
    out in turn. Integers and floats have factors of their own.
    """
    scene = made.scene
    if made.pipeline.force is None:
        return made, "none"
    press, axes = presses(data)[index], scene.force_axes
    count = len(set(press[press != ""].tolist()))
    if not data.has_force(axes):
        return made, "as it was: the presses have no force"
    if count < FEWEST_PRESSES:
        return made, f"as it was: {count} of at least {FEWEST_PRESSES} presses"
    truth, images = data.forces_n(index, axes).astype(np.float64), data.frames[index]
    of_floats = FloatPipeline.from_bundle(made)
    found = {
        "integer": Emulator(made.pipeline).run(images, wanted=["force_n"]).force_n,
        "float": of_floats.run(images, wanted=["force_n"]).force_n,
    }
    factors = {name: force_factors(values, truth) for name, values in found.items()}
    before, after = held_out_mae_n(found["integer"], truth, press)
    if not after < before or any((values <= 0).any() for values in factors.values()):
        return made, "as it was: a scale of its own does not help presses that it was not fitted to"
    floats = dict(made.floats)
    for name in floats:
        if name.startswith("force.") and name.endswith("weights"):
            factor = factors["float" if name.startswith("force.float") else "integer"]
            scaled = floats[name] * factor.reshape(-1, *(1,) * (floats[name].ndim - 1))
            floats[name] = scaled.astype(floats[name].dtype)
    pipeline = made.pipeline.replace(force_n_per_unit=made.pipeline.force_n_per_unit * factors["integer"])
    shown = ", ".join(f"{'xyz'[a]} {factor:.3f}" for a, factor in zip(axes, factors["integer"], strict=True))
    text = f"scaled: {shown}; held-out presses {before:.4f} N before, {after:.4f} N after"
    return replace(made, pipeline=pipeline, floats=floats), text


def force_factors(found: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """The factor of each axis, least squares, of forces (frames, axes); 1 where none is found."""
    energy = (found**2).sum(axis=0)
    return np.where(energy > 0, (found * truth).sum(axis=0) / np.where(energy > 0, energy, 1), 1.0)


def held_out_mae_n(found: np.ndarray, truth: np.ndarray, press: np.ndarray) -> tuple[float, float]:
    """Mean absolute errors without factors, and with those that are fitted to all presses but the frame's."""
    after = np.abs(found - truth)
    for name in set(press[press != ""].tolist()):
        held = press == name
        after[held] = np.abs(found[held] * force_factors(found[~held], truth[~held]) - truth[held])
    touched = press != ""
    return float(np.abs(found - truth)[touched].mean()), float(after[touched].mean())
