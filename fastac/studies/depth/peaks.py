"""How deep trained bundles find presses: light and heavy ones, of other balls, and under another light.

Where noise hides gentle slopes a network that takes them for none finds contacts too shallow, and one that
takes drift for gentle slopes finds depth where there is none. Both show in presses of the virtual fingertip,
whose depth is known.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fastac.flow import frames
from fastac.flow.pipelines import rest_depth_mm
from fastac.flow.steps import virtual_presses
from fastac.models.accuracy import with_background_of
from fastac.models.integer.bundle import Bundle, load_bundle
from fastac.report.tables import text_table
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset
from fastac.sensor.optics import faults
from fastac.sensor.samples import subset
from fastac.studies.depth.attenuation import require_depth

GRID = 4
"""Places along each side at which each ball is pressed, with each load of the scene."""
BRIGHTER = (0.01, 0.03)
"""By these shares all channels are brighter."""
CHANNELS = 0.01
"""Standard deviation of gains of each channel, drawn anew for each frame."""
RECORDED = "as recorded"


@dataclass(frozen=True)
class Found:
    """What presses of one load are off by, in the mean.

    largest_percent : of the largest displacement, relative to the true one; negative where too shallow
    depth_um : absolute, of the depth of the inner pixels
    """

    load_n: float
    largest_percent: float
    depth_um: float


def measured(
    found_mm: np.ndarray, resting_mm: np.ndarray, data: Dataset, loads_n: Sequence[float]
) -> list[Found]:
    """By load, depths found (frames, H, W) against those of the dataset's frames, which has one frame of each
    load in turn; resting_mm : (H, W), found of the background."""
    rest_mm, inner, rows = rest_depth_mm(data), np.s_[..., 1:-1, 1:-1], []
    for k, load_n in enumerate(loads_n):
        found, true = (values[k :: len(loads_n)].astype(np.float64) for values in (found_mm, data.depth_mm))
        deepest = [
            -(depth - rest)[inner].min(axis=(1, 2)) for depth, rest in ((found, resting_mm), (true, rest_mm))
        ]
        rows.append(
            Found(
                load_n,
                100 * float((deepest[0] / deepest[1] - 1).mean()),
                1e3 * float(np.abs(found - true)[inner].mean()),
            )
        )
    return rows


def lights(images: np.ndarray, seed: int = 0) -> dict[str, np.ndarray]:
    """Frames (frames, H, W, C) as they are, and under other light than the background's, by name."""
    gains = np.random.default_rng(seed).normal(1, CHANNELS, (len(images), 1, 1, images.shape[-1]))
    return {
        RECORDED: images,
        **{f"brighter by {100 * share:g}%": faults.gain(images, 1 + share) for share in BRIGHTER},
        f"each channel by {100 * CHANNELS:g}%": faults.gain(images, gains),
    }


def presses(scene: Scene, ball_mm: float, store: Path, *, progress: bool) -> Dataset:
    """Virtual presses of one ball, with each load in turn at places of the scene's held-out grid."""
    protocol = scene.protocol.model_copy(
        update={
            "train_grid": 1,
            "validation_grid": 1,
            "test_grid": GRID,
            "ball_mm": ball_mm,
            "more_balls_mm": (),
            "more_shapes": (),
            "tangential_shares": (),
        }
    )
    file = virtual_presses(scene.model_copy(update={"protocol": protocol}), store, progress=progress)
    data = frames.read(file, scene, store=store, progress=progress)
    return subset(data, data.indices("test"))


def check(bundle: Bundle, folder: Path) -> None:
    """Raise ValueError where the bundle's depth cannot be compared with that of virtual presses."""
    scene = bundle.scene
    if scene.sensor.source != "simulated":
        raise ValueError(
            f"{folder}: sensor.source: {scene.sensor.source}, and this study presses virtual fingertips"
        )
    require_depth(scene, folder)


def measure(
    folders: Sequence[Path], balls_mm: Sequence[float], *, store: Path, progress: bool
) -> Iterator[str]:
    """Measure each folder's bundle on presses of the scene's ball and of others; yields lines of text.

    balls_mm : diameters of the others
    Raises ValueError where a bundle finds no depth, or is not of a virtual sensor.
    """
    bundles = {folder: load_bundle(folder) for folder in folders}
    for folder, bundle in bundles.items():
        check(bundle, folder)
    for folder, bundle in bundles.items():
        yield (
            f"{folder}: bundle {bundle.digest[:16]}: by how many % the largest depth is off, and the depth's"
            f" error in µm, by load; means over {GRID**2} places, simulated"
        )
        yield _table(bundle, balls_mm, store, progress)


def _table(bundle: Bundle, balls_mm: Sequence[float], store: Path, progress: bool) -> str:
    """A line for each ball and light, two columns for each load."""
    scene, rows = bundle.scene, []
    loads_n, own_mm = scene.protocol.loads_n, scene.protocol.ball_mm
    for ball_mm in dict.fromkeys((own_mm, *balls_mm)):
        data = presses(scene, ball_mm, store, progress=progress)
        emulator = with_background_of(bundle.pipeline, data)
        resting_mm = emulator.run(data.background[None], wanted=["depth_mm"]).depth_mm[0]
        cases = lights(data.frames) if ball_mm == own_mm else {RECORDED: data.frames}
        for light, images in cases.items():
            found_mm = emulator.run(images, wanted=["depth_mm"]).depth_mm
            found = measured(found_mm, resting_mm, data, loads_n)
            rows.append(
                [
                    f"{ball_mm:g}",
                    light,
                    *(f"{each.largest_percent:+.1f}" for each in found),
                    *(f"{each.depth_um:.2f}" for each in found),
                ]
            )
    head = [f"{load:g} N, {unit}" for unit in ("%", "µm") for load in loads_n]
    return text_table(["ball, mm", "light", *head], rows)
