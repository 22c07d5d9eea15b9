"""Simple models of the force on frames whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest

from fastac.flow import simple_models
from fastac.sensor import dataset
from fastac.sensor.importers.force_labels import split_by_group
from fastac.sensor.samples import Dataset
from fastac.store.store import open_store

RECORDINGS = ("ball", "cup", "nut", "pear")


def recorded(bend: float = 0.0) -> Dataset:
    """Four recordings of 30 presses at all places; one channel brightens in proportion to the force and, with
    `bend`, to its square."""
    rng = np.random.default_rng(1)
    y, x = np.indices((16, 16))
    group = np.repeat(RECORDINGS, 30)
    force_n = rng.uniform(0, 5, len(group))
    place = rng.uniform(5, 11, (len(group), 2))
    contact = np.exp(-((y - place[:, 0, None, None]) ** 2 + (x - place[:, 1, None, None]) ** 2) / 4)
    frames = np.full((len(group), 16, 16, 3), 60.0)
    frames[..., 1] += (10 * force_n + bend * force_n**2)[:, None, None] * contact
    frames += rng.normal(scale=0.3, size=frames.shape)
    split = np.where(np.arange(len(group)) % 5, "train", "validation")
    return Dataset(
        pitch_mm=0.4,
        channels=("B", "G", "R"),
        source="test",
        background=np.full((16, 16, 3), 60, np.uint8),
        split=np.where(group == RECORDINGS[0], "test", split),
        frames=frames.round().astype(np.uint8),
        force_n=force_n[:, None].astype(np.float32),
        force_axes=("z",),
        group=group,
    )


def errors_n(data: Dataset) -> dict[str, float]:
    truth = data.forces_n(data.indices("test"), (2,))
    found = simple_models.linear_forces_n(data, (2,)) | {
        "quadratic": simple_models.quadratic_force_n(data, (2,))
    }
    assert tuple(found) == simple_models.MODELS
    return {name: np.abs(forces - truth).mean() for name, forces in found.items()}


def test_forces_that_follow_from_the_sum():
    linear, bent = errors_n(recorded()), errors_n(recorded(bend=4.0))
    assert max(linear.values()) < 0.05
    assert bent["quadratic"] < 0.5 * bent["linear"]


def test_wrong_forces_lead_the_robust_ridge_less_astray():
    data = recorded()
    wrong = data.force_n.copy()
    wrong[np.flatnonzero(data.split == "train")[::15]] = -30.0
    misled = errors_n(replace(data, force_n=wrong))
    assert misled["linear"] > 1.0
    assert misled["robust linear"] < misled["linear"] / 3


def test_the_held_out_recording_has_no_part(make_scene, tmp_path):
    """And what the scene says of training has none."""
    scene = make_scene(
        outputs=["force_z"],
        sensor={"channels": "bgr", "source": "recorded", "geometry": "flat", "pitch_mm": 0.4},
        poisson={"solver": "adjoint"},
        force={"clamp": False, "fit": "slopes"},
        training={"labels": "force"},
    )
    data = recorded()
    known = {**vars(data), "split": np.where(data.split == "test", "train", data.split)}
    doubled = np.where(data.group == "cup", 2, 1)[:, None] * data.force_n
    for name, content in (("d", known), ("doubled", known | {"force_n": doubled})):
        dataset.write(tmp_path / f"{name}.h5", **content)
    store = tmp_path / "store"

    def step(file="d", group="ball", *, level_light=False, **training):
        changed = {
            "sensor": scene.sensor.model_copy(update={"level_light": level_light}),
            "training": scene.training.model_copy(update=training),
        }
        own = scene.model_copy(update=changed)
        return simple_models.step_of(tmp_path / f"{file}.h5", own, group, store, progress=False)

    kept = open_store(store)
    found = kept.value(step())
    expected = errors_n(replace(data, split=split_by_group(data.group, ("ball",))))
    assert found == pytest.approx(expected, rel=1e-3)
    assert kept.is_current(step(seed=7, force_epochs=3, press_symmetry=True))
    assert not kept.is_current(step(level_light=True))
    of_cup, of_doubled = (kept.value(step(file, "cup")) for file in ("d", "doubled"))
    assert of_cup["linear"] < 0.05
    assert of_doubled["linear"] == pytest.approx(doubled[data.group == "cup"].mean() / 2, rel=0.05)
