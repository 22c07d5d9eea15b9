"""The bundle: one sensor's trained, quantised model in a folder of JSON and NumPy archives.

    bundle.json    scene, formats, scalars, the content hash
    integers.npz   every integer table, by stage
    floats.npz     the float weights and the learning curves' source of truth

Nothing is pickled. The hash covers scene, scalars and all arrays, so a table that was changed by one bit is
refused; its first 64 bits are readable from a hardware register.
"""

import dataclasses
import hashlib
import json
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from fastac.models.integer import (
    bounds,
    depth,
    dot_follower,
    dot_force,
    dot_windows,
    force,
    frame_validity,
    network,
    sine_transform,
    slope_bridge,
    source,
    words,
)
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.integer.solvers import SOLVERS
from fastac.scenes.schema import Scene, describe, shown
from fastac.store.files import DamagedFileError, inside, load_arrays, write_folder_atomically

FORMAT_VERSION = 4
READABLE_VERSIONS = (3, FORMAT_VERSION)
"""3 knows no dots; all else is the same."""
JSON_FILE = "bundle.json"
CLASSES = {
    cls.__name__: cls
    for cls in (
        network.Requantisation,
        network.Layer,
        network.GradientRatio,
        source.PoissonSource,
        sine_transform.SineTransform,
        depth.Depth,
        depth.DisplacementQuantiser,
        force.PatchForce,
        force.WeightedSum,
        dot_windows.DotWindows,
        slope_bridge.SlopeBridge,
        dot_follower.DotFollower,
        dot_force.DotForce,
        bounds.Stage,
        words.Fixed,
        frame_validity.FrameValidity,
        IntegerPipeline,
    )
}
"""What every bundle may hold, by the names in bundle.json; the solver's classes come from its table."""


class BundleError(ValueError):
    """A bundle that cannot be used; the message is one line that names file, key and value."""


@dataclasses.dataclass(frozen=True, eq=False)
class Bundle:
    """pipeline: every integer; floats: the float models' arrays by name; digest: hex SHA-256 of it all."""

    pipeline: IntegerPipeline
    floats: dict[str, np.ndarray]
    digest: str

    @property
    def scene(self) -> Scene:
        return self.pipeline.scene

    @property
    def hash_word(self) -> int:
        """The first 64 bits of the hash, as the hardware's register shows them."""
        return int(self.digest[:16], 16)


def _flatten(value, name: str, arrays: dict[str, np.ndarray]):
    """A stage as JSON, its arrays moved to `arrays` under dotted names."""
    if isinstance(value, np.ndarray):
        arrays[name] = value
        return {"array": name}
    if isinstance(value, Scene):
        return {"scene": value.model_dump(mode="json")}
    if dataclasses.is_dataclass(value):
        fields = {
            f.name: _flatten(getattr(value, f.name), f"{name}.{f.name}".removeprefix("."), arrays)
            for f in dataclasses.fields(value)
        }
        return {"class": type(value).__name__, "fields": fields}
    if isinstance(value, tuple):
        return {"tuple": [_flatten(v, f"{name}.{k}", arrays) for k, v in enumerate(value)]}
    if isinstance(value, np.generic):
        return value.item()
    return value


def _solver_classes(scene: Scene) -> dict[str, type]:
    """The classes of the scene's solver and of its stages, by name."""
    if not scene.wants_solver:
        return {}
    solver = SOLVERS[scene.poisson.solver]
    kinds = (solver, *(field.type for field in dataclasses.fields(solver)))
    return {kind.__name__: kind for kind in kinds if dataclasses.is_dataclass(kind)}


def _restore(value, arrays: dict[str, np.ndarray], classes: dict[str, type], scene: Scene):
    if not isinstance(value, dict):
        return value
    if "array" in value:
        return arrays[value["array"]]
    if "scene" in value:
        return scene
    if "tuple" in value:
        return tuple(_restore(v, arrays, classes, scene) for v in value["tuple"])
    if "class" in value:
        found = {k: _restore(v, arrays, classes, scene) for k, v in value["fields"].items()}
        return classes[value["class"]](**found)
    return value


def _digest(content: dict, arrays: dict[str, np.ndarray]) -> str:
    digest = hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode())
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name} {array.dtype.str} {array.shape}".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def _narrow(array: np.ndarray) -> np.ndarray:
    """The smallest signed type that holds an int64 table; stages widen it again on loading."""
    if array.dtype != np.int64 or not array.size:
        return array
    for kind in (np.int8, np.int16, np.int32):
        info = np.iinfo(kind)
        if array.min() >= info.min and array.max() <= info.max:
            return array.astype(kind)
    return array


def save(path: Path | str, pipeline: IntegerPipeline, floats: dict[str, np.ndarray]) -> Bundle:
    """Write a bundle folder, replacing an older one only when the new one is complete; returns it."""
    path = Path(path)
    integers: dict[str, np.ndarray] = {}
    content = {"format_version": FORMAT_VERSION, "pipeline": _flatten(pipeline, "", integers)}
    everything = integers | {f"float.{k}": v for k, v in floats.items()}
    digest = _digest(content, everything)
    with write_folder_atomically(path) as temporary:
        np.savez_compressed(temporary / "integers.npz", **{k: _narrow(v) for k, v in integers.items()})
        np.savez_compressed(temporary / "floats.npz", **floats)
        text = json.dumps({"sha256": digest, **content}, indent=1, sort_keys=True)
        (temporary / JSON_FILE).write_text(text + "\n")
    return Bundle(pipeline, floats, digest)


def _arrays(folder: Path, name: str) -> dict[str, np.ndarray]:
    path = _file(folder, name)
    try:
        return load_arrays(path)
    except FileNotFoundError:
        raise BundleError(f"{path}: no such file") from None
    except DamagedFileError as error:
        raise BundleError(str(error)) from None
    except OSError as error:
        raise BundleError(f"{path}: {error.strerror or error}") from None


def _file(folder: Path, name: str) -> Path:
    """A file of a bundle, which may come from elsewhere: links out of its folder are not followed."""
    try:
        return inside(folder, name)
    except DamagedFileError as error:
        raise BundleError(str(error)) from None


def load(path: Path | str) -> Bundle:
    """The bundle in a folder. Raises BundleError where it is incomplete, malformed, or its hash differs."""
    content = _content(path := Path(path))
    file = path / JSON_FILE
    try:
        scene = Scene.model_validate(content["pipeline"]["fields"]["scene"]["scene"])
    except ValidationError as error:
        raise BundleError(f"{file}: scene: {describe(error)}") from None
    except (KeyError, TypeError) as error:
        raise BundleError(f"{file}: pipeline: {error!r}") from None
    return _of_content(content, path, scene)


def load_for(path: Path | str, scene: Scene) -> Bundle:
    """As `load`, with the scene that the bundle was made for.

    For steps of a build: they are given the scene, and of it only what they read counts.
    """
    return _of_content(_content(Path(path)), Path(path), scene)


def _content(path: Path) -> dict:
    file = _file(path, JSON_FILE)
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise BundleError(f"{file}: no such file; is {path} a bundle folder?") from None
    except (OSError, ValueError, RecursionError) as error:
        raise BundleError(f"{file}: not readable JSON: {error}") from None
    if not isinstance(content, dict) or content.get("format_version") not in READABLE_VERSIONS:
        version = content.get("format_version") if isinstance(content, dict) else None
        raise BundleError(
            f"{file}: format_version = {shown(version)}: expected {' or '.join(map(str, READABLE_VERSIONS))}"
        )
    return content


def _of_content(content: dict, path: Path, scene: Scene) -> Bundle:
    stated = content.pop("sha256", None)
    integers = {
        k: v.astype(np.int64) if v.dtype.kind == "i" else v for k, v in _arrays(path, "integers.npz").items()
    }
    floats = _arrays(path, "floats.npz")
    digest = _digest(content, integers | {f"float.{k}": v for k, v in floats.items()})
    if stated != digest:
        raise BundleError(
            f"{path}: sha256 = {shown(stated)}: the content's is {digest}; it was changed or damaged"
        )
    try:
        pipeline = _restore(content["pipeline"], integers, CLASSES | _solver_classes(scene), scene)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BundleError(f"{path / JSON_FILE}: pipeline: {error!r}") from None
    return Bundle(pipeline, floats, digest)


def load_bundle(path: Path) -> Bundle:
    """The bundle in a folder, or in a build folder's `bundle`."""
    return load(bundle_folder(path))


def bundle_folder(path: Path) -> Path:
    """The folder of `load_bundle`'s bundle."""
    inside = path / "bundle"
    return inside if (inside / JSON_FILE).exists() else path
