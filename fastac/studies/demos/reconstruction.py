"""Test objects on the virtual sensor, reconstructed by several bundles: the paper's third figure of results.

Every object is pressed once; the deformed skin is rendered with the channels of each bundle's own scene, so
that RGB and RGB-NIR bundles are compared on the same contact. Everything is simulated.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fastac.flow import frames
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer.bundle import Bundle
from fastac.models.result import Result
from fastac.report.tables import text_table
from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.mechanics.layer import Layer
from fastac.sensor.mechanics.object_press import ObjectPress, press_object
from fastac.sensor.mechanics.objects import OBJECTS
from fastac.sensor.protocol import FingertipError
from fastac.store.progress import progress_bar

LOAD_FACTOR = 3.0
"""Default load in multiples of the largest load in the first bundle's protocol."""


@dataclass(frozen=True)
class Reconstruction:
    """One object as reconstructed by one bundle's integer model."""

    frame: np.ndarray
    """(H, W, C) uint8, the rendered image."""
    result: Result
    """The integer model's outputs, of one frame."""

    def errors(self, truth: ObjectPress) -> dict[str, float]:
        """Mean absolute errors of normals (degrees) and depth (mm) in contact, of depth on inner pixels."""
        touching = truth.pressed.in_contact
        cosine = np.einsum("hwi,hwi->hw", self.result.normals[0], truth.pressed.normals)
        depth = np.abs(self.result.depth_mm[0] - truth.pressed.depth_mm)
        return {
            "contact_normal_mae_deg": float(np.degrees(np.arccos(np.clip(cosine, -1, 1)))[touching].mean()),
            "contact_depth_mae_mm": float(depth[touching].mean()),
            "depth_mae_mm": float(depth[1:-1, 1:-1].mean()),
        }


@dataclass(frozen=True)
class ObjectResult:
    """One object: the true deformation of the skin, and every bundle's reconstruction of it."""

    name: str
    sensor: Sensor
    truth: ObjectPress
    found: dict[str, Reconstruction]
    """By `title` of the bundle."""


def title(bundle: Bundle) -> str:
    """The name of the bundle's scene and its channels, e.g. "paper, B G R NIR"."""
    return f"{bundle.scene.name}, {' '.join(bundle.scene.sensor.channel_names)}"


def check(bundles: dict[Path, Bundle]) -> None:
    """Raise FingertipError unless all bundles compute depth for the same simulated skin."""
    first = None
    for path, bundle in bundles.items():
        scene = bundle.scene
        if scene.sensor.source != "simulated":
            raise FingertipError(f"{path}: sensor.source = {scene.sensor.source!r}: expected 'simulated'")
        if not scene.wants_solver:
            raise FingertipError(f"{path}: outputs = {scene.outputs}: expected depth, or a force from depth")
        skin = {key: getattr(scene.sensor, key) for key in ("geometry", "ellipsoid", "elastomer", "pitch_mm")}
        skin["size"] = scene.sensor.height_px, scene.sensor.width_px
        first = first or skin
        if skin != first:
            key = next(key for key in skin if skin[key] != first[key])
            raise FingertipError(f"{path}: sensor.{key}: differs from the first bundle's")
    names = [title(bundle) for bundle in bundles.values()]
    for name in names:
        if names.count(name) > 1:
            raise FingertipError(f"{name}: two bundles of this scene and these channels")


def reconstruct(bundles: dict[Path, Bundle], load_n: float | None, *, progress: bool) -> list[ObjectResult]:
    """Press every object with `load_n` (None: LOAD_FACTOR) and reconstruct it by every bundle.

    Raises FingertipError where the bundles do not fit together, ContactError where the load exceeds what the
    gel can carry.
    """
    check(bundles)
    scene = next(iter(bundles.values())).scene
    load_n = LOAD_FACTOR * max(scene.protocol.loads_n) if load_n is None else load_n
    layer, shown = Layer(scene.sensor), []
    for name, make in progress_bar(OBJECTS.items(), desc="objects", enabled=progress):
        truth, found = press_object(layer, make(), name, load_n), {}
        for bundle in bundles.values():
            sensor = bundle.scene.sensor
            frame = frames.of_press(truth.pressed, sensor, np.random.default_rng(scene.protocol.seed))
            found[title(bundle)] = Reconstruction(frame, Emulator(bundle.pipeline).run(frame[None]))
        shown.append(ObjectResult(name, scene.sensor, truth, found))
    return shown


def summary(shown: list[ObjectResult]) -> dict:
    """The errors of all reconstructions, as JSON content."""
    return {
        "source": "simulated",
        "load_n": shown[0].truth.pressed.pose["load_n"],
        "objects": {
            item.name: {name: found.errors(item.truth) for name, found in item.found.items()}
            for item in shown
        },
    }


def table(content: dict) -> str:
    """The errors as text: a row for each object and bundle."""
    keys = ("contact_normal_mae_deg", "contact_depth_mae_mm", "depth_mae_mm")
    return text_table(
        ["object", "bundle", *keys],
        [
            [name, bundle, *(f"{errors[key]:.4f}" for key in keys)]
            for name, found in content["objects"].items()
            for bundle, errors in found.items()
        ],
    )
