"""A virtual flat gel that is recorded as a laboratory records one: presses of one ball, each with its circle.

The gel is larger than what the camera sees of it, as in a GelSight, so the skin at the border of the image
moves too. What a recording does not know, the skin outside the circles, is known here.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fastac.models.training.force.light import under_other_light
from fastac.scenes.schema import Scene
from fastac.sensor import dataset
from fastac.sensor.dataset import Dataset
from fastac.sensor.geometry import ball_slopes, normals_from_slopes, pixel_centres_mm
from fastac.sensor.mechanics.indenter import Ball
from fastac.sensor.mechanics.layer import Layer
from fastac.sensor.mechanics.layer_rig import press_indenter
from fastac.sensor.mechanics.press import ContactError
from fastac.sensor.mechanics.random_indenter import KINDS
from fastac.sensor.optics.camera import background, render
from fastac.sensor.protocol import FingertipError
from fastac.store.files import load_arrays, save_arrays

BALL_MM = 4.7
BEYOND_PX = 32
"""How far the gel goes on beyond each side of the image."""
COUNTS = {"heavy": 33, "graded": 33, "ball": 48, "other": 48}
"""Presses by kind: heavy ones and ones from light to heavy, to train with; presses to test with, of the same
ball, and of other balls, cylinders, edges, punches and lumps."""
LOADS_N = {"heavy": (1.4, 3.0), "graded": (0.1, 3.0), "ball": (0.03, 3.0), "other": (0.05, 2.0)}
"""The heavy ones have contact radii of 1.8 to 2.2 mm; those of the FOTS presses are labelled 1.8 to 2.35."""
REACH = {"heavy": 0.19, "graded": 0.19, "ball": 0.33, "other": 0.33}
"""Of the image's width: how far along x and y presses are from its middle, at most."""
MOST_TRIES = 100
SKINS, RECORDING = "skins.npz", "recording.h5"
GEL = {
    "source": "simulated",
    "elastomer": {"modulus_mpa": 0.2, "thickness_mm": 4.0, "thickness_variation": 0.0},
    "light": {"distance_mm": 30.0, "below_mm": 30.0, "softening_mm": 0.0, "ambient": 0.4},
    "noise_dn": 0.5,
    "electrons_per_dn": 300.0,
    "grain": 0.01,
}
"""The gel, its distant light, and the noise of a pixel that is the mean of six of a photograph's: about one
digital number, as in the FOTS presses."""


@dataclass(frozen=True)
class Conditions:
    """What a recording suffers from; each is a suspected cause of false depth."""

    brightest_dn: float = 245.0
    """Of the background. Steep skin that faces a lamp then saturates."""
    cast_shadows: bool = True
    light_noise: float = 0.03
    """Standard deviation of each channel's gain from press to press: what is not touched looks different too,
    by 5 digital numbers. In the FOTS presses the mean difference there is up to 21."""
    circle_noise_mm: float = 0.05
    """Standard deviation of the labelled circles' centres, along each axis, and radii: a pixel of a
    photograph of 240 × 320."""
    circle_bias_mm: float = 0.0
    """By how much all circles are too large."""
    presses: str = "heavy"
    """The kind that trains."""


@dataclass(frozen=True, eq=False)
class Skins:
    """The pressed skin inside the image, (N, H, W, …), and where it touches."""

    kind: np.ndarray
    normals: np.ndarray
    depth_mm: np.ndarray
    in_contact: np.ndarray
    at_mm: np.ndarray
    """(N, 2), x and y of the indenters' axes."""
    radius_mm: np.ndarray
    """(N,), of a disc with the contact's area."""

    def __getitem__(self, index: np.ndarray) -> "Skins":
        return Skins(**{name: values[index] for name, values in vars(self).items()})


def virtual(scene: Scene) -> Scene:
    """A virtual gel of a recorded scene's size, pitch and channels, trained as the scene says.

    Raises FingertipError for a scene of another kind.
    """
    sensor = scene.sensor
    if sensor.geometry != "flat" or not scene.wants_solver or scene.poisson.mode != "difference":
        raise FingertipError(
            f"{scene.name}: expected a flat gel, the output depth and poisson.mode 'difference'"
        )
    size = {name: getattr(sensor, name) for name in ("height_px", "width_px", "pitch_mm", "channels")}
    return Scene.model_validate(
        {
            "name": f"{scene.name}-depth",
            "outputs": ("normals", "depth"),
            "sensor": {"geometry": "flat", **size, **GEL},
            "numbers": scene.numbers.model_dump(),
            "poisson": scene.poisson.model_dump(),
            "training": scene.training.model_dump(),
        }
    )


def write_skins(folder: Path, scene: Scene, counts: dict[str, int], seed: int) -> None:
    """A step: press the gel of a virtual scene; loads are spread evenly over the logarithm of their range."""
    sensor = scene.sensor
    size = {side: getattr(sensor, side) + 2 * BEYOND_PX for side in ("height_px", "width_px")}
    layer = Layer(sensor.model_copy(update=size))
    middle = np.s_[BEYOND_PX:-BEYOND_PX, BEYOND_PX:-BEYOND_PX]
    span = sensor.width_px * sensor.pitch_mm
    makers = list(KINDS.values())
    found: dict[str, list] = {}
    for part, (kind, count) in enumerate(counts.items()):
        low, high = LOADS_N[kind]
        for k in range(count):
            rng = np.random.default_rng((seed, part, k))
            for _ in range(MOST_TRIES):
                load_n = low * (high / low) ** ((k + rng.uniform()) / count)
                at_mm = rng.uniform(-REACH[kind], REACH[kind], 2) * span
                indenter = makers[k % len(makers)](rng) if kind == "other" else Ball(BALL_MM)
                try:
                    skin = press_indenter(layer, indenter, *at_mm, load_n)
                except ContactError:
                    continue
                break
            else:
                raise ContactError(f"{kind} press {k}: none of {MOST_TRIES} can be carried by the gel")
            known = {
                "kind": kind,
                "normals": skin.normals[middle].astype(np.float32),
                "depth_mm": skin.depth_mm[middle].astype(np.float32),
                "in_contact": skin.in_contact[middle],
                "at_mm": at_mm,
                "radius_mm": np.sqrt(skin.in_contact.sum() * sensor.pitch_mm**2 / np.pi),
            }
            for key, value in known.items():
                found.setdefault(key, []).append(value)
    save_arrays(folder / SKINS, {key: np.array(values) for key, values in found.items()})


def read_skins(path: Path, presses: str) -> Skins:
    """The presses of the kind that trains, and those to test with."""
    skins = Skins(**load_arrays(path))
    return skins[np.isin(skins.kind, (presses, "ball", "other"))]


def write_recording(folder: Path, scene: Scene, skins: Path, conditions: dict, seed: int) -> None:
    """A step: `recorded` as a dataset."""
    own = Conditions(**conditions)
    data = recorded(read_skins(skins, own.presses), scene, own, seed)
    dataset.write(
        folder / RECORDING,
        pitch_mm=data.pitch_mm,
        channels=data.channels,
        source=data.source,
        background=data.background,
        split=data.split,
        frames=data.frames,
        normals=data.normals,
        depth_mm=data.depth_mm,
        valid=data.valid,
        indenter=data.indenter,
    )


def recorded(skins: Skins, scene: Scene, conditions: Conditions, seed: int) -> Dataset:
    """The presses as a recording of the virtual gel, in their order, and last the untouched gel.

    Presses that train, and the untouched gel, are in split train: the labels of each are the ball's normals
    inside a circle. Those to test with are in split test, their normals known everywhere, as is all depth.
    """
    light = {"brightest_dn": conditions.brightest_dn, "cast_shadows": conditions.cast_shadows}
    sensor = scene.sensor
    sensor = sensor.model_copy(update={"light": sensor.light.model_copy(update=light)})
    rng = np.random.default_rng(seed)
    untouched = background(sensor, rng)
    views = zip(skins.normals.astype(np.float64), skins.depth_mm.astype(np.float64), strict=True)
    frames = [render(normals, depth_mm, sensor, rng) for normals, depth_mm in views]
    trains = np.append(skins.kind == conditions.presses, True)
    x, y = pixel_centres_mm(sensor)
    count, image = len(trains), x.shape
    normals = np.concatenate([skins.normals, np.broadcast_to(np.float32([0, 0, 1]), (1, *image, 3))])
    valid = np.ones((count, *image), bool)
    centre_px, radius_px = np.full((count, 2), np.nan), np.full(count, np.nan)
    for k in np.flatnonzero(trains[:-1]):
        error = rng.standard_normal(3) * conditions.circle_noise_mm
        at_mm = skins.at_mm[k] + error[:2]
        radius_mm = skins.radius_mm[k] + error[2] + conditions.circle_bias_mm
        radius_mm = min(radius_mm, BALL_MM / 2 - sensor.pitch_mm / 10)  # a circle is smaller than its ball
        valid[k] = inside = np.hypot(x - at_mm[0], y - at_mm[1]) <= radius_mm
        normals[k] = np.nan
        slopes = ball_slopes(x[inside] - at_mm[0], y[inside] - at_mm[1], BALL_MM)
        normals[k][inside] = normals_from_slopes(*slopes)
        centre_px[k] = at_mm / sensor.pitch_mm + (np.array(image[::-1]) - 1) / 2
        radius_px[k] = radius_mm / sensor.pitch_mm
    data = Dataset(
        pitch_mm=sensor.pitch_mm,
        channels=sensor.channel_names,
        source=f"simulated: ball presses on a flat gel, seed {seed}",
        background=untouched,
        split=np.full(count, "train"),
        frames=np.stack([*frames, untouched]),
        normals=normals,
        depth_mm=np.concatenate([skins.depth_mm, np.zeros((1, *image), np.float32)]),
        valid=valid,
        indenter={"center_px": centre_px, "radius_px": radius_px, "ball_mm": np.full(count, BALL_MM)},
    )
    lit = under_other_light(data, conditions.light_noise, seed).frames
    lit[-1] = untouched
    return replace(data, frames=lit, split=np.where(trains, "train", "test"))
