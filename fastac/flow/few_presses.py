"""The few presses of a second unit: which frames are of one press, and the pixels that are learned from."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from fastac.flow import frames
from fastac.models.integer.bundle import Bundle
from fastac.models.training.labelled_pixels import training_pixels
from fastac.models.training.whole_frames.frames import WholeFrames
from fastac.models.training.whole_frames.usable_frames import unknown_depth, whole_frames
from fastac.scenes.schema import Scene
from fastac.sensor import groups
from fastac.sensor.dataset import Dataset


class AdaptError(ValueError):
    """Presses that a bundle cannot be adapted to; the message is one line."""


def presses(data: Dataset) -> np.ndarray:
    """The press that each frame is of, (frames,) text, "" for frames without contact.

    Frames of one recording (`group`) at one place are of one press, whatever their loads are. Where no place
    is known a recording is one press, and without recordings the whole dataset is.
    """
    group = np.full(len(data), "data", object) if data.group is None else data.group.astype(object)
    places = groups.places(data)
    if not places.shape[1]:
        places = np.zeros((len(data), 1))
    text = np.array([f"{g}: {' '.join(f'{x:.6g}' for x in p)}" for g, p in zip(group, places, strict=True)])
    return np.where(data.at_rest | np.isnan(places).any(axis=1), "", text)


def known_presses(data: Dataset) -> list[str]:
    """Names of the presses that may be learned from, those of split test excepted, in the file's order."""
    return list(dict.fromkeys(name for name in presses(data)[data.split != "test"].tolist() if name))


def read(path: Path, scene: Scene, *, store: Path, progress: bool = False) -> Dataset:
    """The few presses; raises AdaptError, or what `frames.read` raises, where they cannot be learned from."""
    data = frames.read(path, scene, store=store, progress=progress)
    if scene.training.labels == "force":
        raise AdaptError(
            f"scene {scene.name}: training.labels = 'force': expected 'geometry'; what such a network says"
            " is no normal, so that presses of known geometry cannot tune it"
        )
    if scene.learns_force_of_slopes:
        key = "force_steps" if scene.training.force_steps else "force_weight"
        raise AdaptError(
            f"scene {scene.name}: training.{key} = {getattr(scene.training, key):g}: expected 0; such a"
            " network has bent its normals for the force, and presses of known geometry would straighten them"
        )
    if data.normals is None:
        raise AdaptError(f"{path}: normals: missing, and the pixel network is tuned on them")
    if not known_presses(data):
        raise AdaptError(f"{path}: split: no frame in contact outside of 'test'")
    return data


def pixels_of(data: Dataset, scene: Scene, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Features (pixels, inputs) and normals (pixels, 3) of the labelled pixels of `chosen` frames, a mask.

    Of few presses all pixels count, whatever `training.normals_share` is.
    """
    split = np.where(chosen, "train", "test")
    settings = scene.training.model_copy(update={"normals_share": 1.0})
    return training_pixels(replace(data, split=split), settings, scene.network.smoothing_px)


def pressed_skins(known: Bundle, data: Dataset, skin: Dataset, chosen: np.ndarray) -> WholeFrames | None:
    """The `chosen` frames, a mask, for a network that learns from the depth, too; None where the bundle's
    scene has no `training.depth_weight`, or the depth of some pixels is not known. From the force it does not
    learn: the presses are too few.

    data, skin : the new unit's, without and with what `training.skin_alone` leaves out
    """
    split = np.where(chosen, "train", "test")
    data, skin = replace(data, split=split), replace(skin, split=split)
    if not known.scene.training.depth_weight or unknown_depth(data):
        return None
    rest_mm = known.pipeline.rest_depth_mm if data.rest_depth_mm is None else data.rest_depth_mm
    training = known.scene.training.model_copy(update={"force_weight": 0.0})
    return whole_frames(data, skin, known.scene.model_copy(update={"training": training}), rest_mm)
