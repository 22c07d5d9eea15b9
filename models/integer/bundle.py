"""The bundle: one sensor's trained, quantised model in a folder of JSON and NumPy archives.

    bundle.json    scene, formats, scalars, the content hash
    integers.npz   every integer table, by stage
    floats.npz     the float weights and the learning curves' source of truth

A folder can also be carried in one file (bundle_files.py). Nothing is pickled. The hash covers scene,
scalars and all arrays, so a table that was changed by one bit is refused; its first 64 bits are readable from
a hardware register.
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
    force_interval,
    frame_validity,
    network,
    sine_transform,
    slope_bridge,
    source,
    words,
)
from fastac.models.integer.bundle_files import (
    FLOATS,
    INTEGERS,
    JSON_FILE,
    SUFFIX,
    Archive,
    BundleError,
    Folder,
    open_files,
    version_error,
)
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.integer.solvers import SOLVERS
from fastac.scenes.schema import Scene, describe, shown
from fastac.store.files import write_folder_atomically

FORMAT_VERSION = 4
READABLE_VERSIONS = (3, FORMAT_VERSION)
"""3 knows no dots; all else is the same."""
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
        force_interval.ForceInterval,
        bounds.Stage,
        words.Fixed,
        frame_validity.FrameValidity,
        IntegerPipeline,
    )
}
"""What every bundle may hold, by the names in bundle.json; the solver's classes come from its table."""
LATER = {"interval": None, "block_px": 1, "cut_rows": 0}
"""Fields that are younger than the format, with what they were before there was a choice: of such a bundle
they are not written, so that it has the hash that it always had."""


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
            if f.name not in LATER or getattr(value, f.name) != LATER[f.name]
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
        np.savez_compressed(temporary / INTEGERS, **{k: _narrow(v) for k, v in integers.items()})
        np.savez_compressed(temporary / FLOATS, **floats)
        text = json.dumps({"sha256": digest, **content}, indent=1, sort_keys=True)
        (temporary / JSON_FILE).write_text(text + "\n")
    return Bundle(pipeline, floats, digest)


def load(path: Path | str) -> Bundle:
    """The bundle in a folder or a single file.

    Raises BundleError where it is incomplete, malformed, or its hash differs.
    """
    content = _content(files := open_files(Path(path)))
    place = files.place(JSON_FILE)
    try:
        scene = Scene.model_validate(content["pipeline"]["fields"]["scene"]["scene"])
    except ValidationError as error:
        raise BundleError(f"{place}: scene: {describe(error)}") from None
    except (KeyError, TypeError) as error:
        raise BundleError(f"{place}: pipeline: {error!r}") from None
    return _of_content(content, files, scene)


def load_for(path: Path | str, scene: Scene) -> Bundle:
    """As `load`, with the scene that the bundle was made for.

    For steps of a build: they are given the scene, and of it only what they read counts.
    """
    files = open_files(Path(path))
    return _of_content(_content(files), files, scene)


def _content(files: Folder | Archive) -> dict:
    place = files.place(JSON_FILE)
    try:
        content = json.loads(files.content().decode("utf-8"))
    except BundleError:
        raise
    except (ValueError, RecursionError) as error:
        raise BundleError(f"{place}: not readable JSON: {error}") from None
    if not isinstance(content, dict) or content.get("format_version") not in READABLE_VERSIONS:
        version = content.get("format_version") if isinstance(content, dict) else None
        raise version_error(place, version, READABLE_VERSIONS)
    return content


def _of_content(content: dict, files: Folder | Archive, scene: Scene) -> Bundle:
    stated = content.pop("sha256", None)
    integers = {
        k: v.astype(np.int64) if v.dtype.kind == "i" else v for k, v in files.arrays(INTEGERS).items()
    }
    floats = files.arrays(FLOATS)
    digest = _digest(content, integers | {f"float.{k}": v for k, v in floats.items()})
    if stated != digest:
        raise BundleError(
            f"{files.path}: sha256 = {shown(stated)}: the content's is {digest}; it was changed or damaged"
        )
    if files.digest not in (None, digest):
        raise BundleError(
            f"{files.path}: bundle_sha256 = {shown(files.digest)}: the bundle's is {digest};"
            " the manifest is another bundle's"
        )
    try:
        pipeline = _restore(content["pipeline"], integers, CLASSES | _solver_classes(scene), scene)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BundleError(f"{files.place(JSON_FILE)}: pipeline: {error!r}") from None
    return Bundle(pipeline, floats, digest)


def load_bundle(path: Path) -> Bundle:
    """The bundle in a folder, in a build folder's `bundle`, or in a single file."""
    return load(bundle_folder(path))


def bundle_folder(path: Path) -> Path:
    """The folder, or the single file, of `load_bundle`'s bundle."""
    inside = path / "bundle"
    return inside if (inside / JSON_FILE).exists() else path


def is_bundle(path: Path) -> bool:
    """Whether a path is meant to be a bundle: a folder, or a single file by its name."""
    return path.is_dir() or path.suffix == SUFFIX
