"""Which of a dataset's frames a pixel network is trained on as a whole, and what a dataset lacks for it."""

import numpy as np

from fastac.models.training.whole_frames.frames import WholeFrames
from fastac.models.training.whole_frames.partly_labelled import BallContacts, PartlyLabelled
from fastac.scenes.schema import Scene
from fastac.sensor.contact_circle import is_whole
from fastac.sensor.dataset import Dataset


def _whole(data: Dataset) -> bool:
    """Whether the depth of every pixel is known."""
    return data.depth_mm is not None and (data.valid is None or bool(data.valid.all()))


def unknown_depth(data: Dataset) -> str | None:
    """What a dataset lacks to learn depth from, with the key at fault; None: nothing."""
    if _whole(data):
        return None
    known = data.indenter or {}
    balls = np.isfinite(known["ball_mm"]) if "ball_mm" in known else np.zeros(len(data), bool)
    if any(balls[k] and is_whole(data, k) for k in data.indices("train")):
        return None
    lack = "depth_mm: missing" if data.depth_mm is None else "valid: not every pixel is"
    return (
        f"{lack}, and training.depth_weight needs the depth of every pixel, or whole contact circles of balls"
        " (indenter/radius_px, indenter/ball_mm); 0 does without"
    )


def whole_frames(data: Dataset, skin: Dataset, scene: Scene, rest_depth_mm: np.ndarray) -> WholeFrames:
    """The frames of a dataset, to learn from what the scene says; nothing is lacking for it
    (`unknown_depth`).

    skin : the dataset with those normals valid that are learned from; rest_depth_mm : (H, W)
    """
    apart = BallContacts if scene.training.depth_weight else PartlyLabelled
    return (WholeFrames if _whole(data) else apart)(data, skin, scene, rest_depth_mm)
