"""The dataset format: one HDF5 file, the same for simulated and recorded frames.

    frames          (N, H, W, C) uint8      attributes: pitch_mm, channels ("B,G,R,NIR"), source,
    background      (H, W, C) uint8                     format_version; left_out (samples dropped), if any;
                                                        photograph_height_px, photograph_width_px (before
                                                        they were resampled), if they were
    split           (N,) text: train, validation or test
    normals         (N, H, W, 3) float32    outward unit normals            ┐
    depth_mm        (N, H, W) float32       z, the skin's height            │ each present only
    valid           (N, H, W) bool          pixels where normals and depth  │ if it is known
                                            are known; absent: everywhere   │
    force_n         (N, axes) float32       z is positive in compression    │
    group           (N,) text               the recording of each frame     │
    rest_depth_mm   (H, W) float32          z of the undeformed skin        │
    markers_px      (N, M, 2) float32       (u, v) of each dot's centre     │
    tangential_mm   (N, H, W, 2) float32    displacement d_x, d_y of the    │
                                            skin point that is at the pixel │
                                            when nothing touches            │
    indenter/…      (N, …) numbers          pose and shape; NaN: no indenter┘

Instead of `frames` there may be `raw10` (N, 4H, 4W) uint16, RAW10 images as the camera sends them; the
background is then a RAW10 image too, (4H, 4W) uint16. fastac/flow/frames.py turns them into channels.

All data are in the file itself, as they are or compressed by gzip or lzf; texts are not compressed. A file
that declares more than its bytes can hold is refused before anything is read (sensor/hdf5_checks.py).

`force_n` has the axes x, y, z, or those that the attribute force_axes lists ("z" for a one-axis force gauge).
Where `valid` is true, ground truth is finite and normals are unit vectors with n_z > 0; elsewhere it is
undefined (the importers write NaN there, so that code that ignores `valid` fails visibly).
"""

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path

import h5py
import numpy as np

from fastac.scenes.schema import Scene
from fastac.sensor import hdf5_checks
from fastac.sensor.hdf5_checks import UnsafeFileError, check_array, check_attribute, check_link
from fastac.sensor.samples import FORCE_AXES, SPLITS, Dataset, DatasetError, check
from fastac.store.files import write_atomically

__all__ = ["FORCE_AXES", "SPLITS", "Dataset", "DatasetError", "read", "write"]

FORMAT_VERSION = 1
CHUNKED = ("frames", "raw10", "normals", "depth_mm", "valid", "tangential_mm")
"""Arrays stored and compressed in chunks of one frame, so that a frame is read on its own."""
ARRAYS = {
    "background": np.uint8,
    "frames": np.uint8,
    "raw10": np.uint16,
    "normals": np.float32,
    "depth_mm": np.float32,
    "valid": np.bool_,
    "force_n": np.float32,
    "rest_depth_mm": np.float32,
    "markers_px": np.float32,
    "tangential_mm": np.float32,
}
TEXTS = ("split", "group")
PHOTOGRAPH = ("photograph_height_px", "photograph_width_px")
REQUIRED = ("background", "split")


def _type(key: str, raw10: bool) -> type:
    return np.uint16 if raw10 and key == "background" else ARRAYS[key]


def write(
    path: Path | str,
    *,
    pitch_mm: float,
    channels: tuple[str, ...],
    source: str,
    background: np.ndarray,
    split: np.ndarray,
    frames: np.ndarray | None = None,
    raw10: np.ndarray | None = None,
    normals: np.ndarray | None = None,
    depth_mm: np.ndarray | None = None,
    valid: np.ndarray | None = None,
    force_n: np.ndarray | None = None,
    indenter: dict[str, np.ndarray] | None = None,
    rest_depth_mm: np.ndarray | None = None,
    force_axes: tuple[str, ...] = FORCE_AXES,
    group: np.ndarray | None = None,
    markers_px: np.ndarray | None = None,
    tangential_mm: np.ndarray | None = None,
    left_out: int = 0,
    photograph_px: tuple[int, int] | None = None,
) -> None:
    """Write a dataset to `path`; the file appears complete or not at all. See the module for shapes and
    units.

    Floating-point ground truth is stored as float32. Raises DatasetError on anything that `read` refuses.
    """
    path = Path(path)
    given = {
        "background": background,
        "frames": frames,
        "raw10": raw10,
        "normals": normals,
        "depth_mm": depth_mm,
        "valid": valid,
        "force_n": force_n,
        "rest_depth_mm": rest_depth_mm,
        "markers_px": markers_px,
        "tangential_mm": tangential_mm,
    }
    arrays = {}
    for key, array in given.items():
        if array is not None:
            array = np.asarray(array)
            kind = _type(key, raw10 is not None)
            if not (kind is np.float32 and array.dtype.kind == "f") and array.dtype != kind:
                raise DatasetError(f"{path}: {key} = {array.dtype}: expected {np.dtype(kind)}")
            arrays[key] = array.astype(kind, copy=False)
    poses = None if indenter is None else {key: np.asarray(array, float) for key, array in indenter.items()}
    texts = {"split": np.asarray(split, dtype=str)}
    if group is not None:
        texts["group"] = np.asarray(group, dtype=str)
    axes = tuple(force_axes)
    known = {"indenter": poses, "force_axes": axes, "left_out": left_out, "photograph_px": photograph_px}
    data = Dataset(pitch_mm, tuple(channels), source, **known, **arrays, **texts)
    check(data, None, str(path))
    if not path.parent.is_dir():
        raise DatasetError(f"{path}: {path.parent} is not a folder")
    with write_atomically(path) as temporary, h5py.File(temporary, "w") as file:
        file.attrs["format_version"] = FORMAT_VERSION
        file.attrs["pitch_mm"] = pitch_mm
        file.attrs["channels"] = ",".join(channels)
        file.attrs["source"] = source
        if force_n is not None and axes != FORCE_AXES:
            file.attrs["force_axes"] = ",".join(axes)
        if left_out:
            file.attrs["left_out"] = left_out
        for key, size in zip(PHOTOGRAPH, photograph_px or (), strict=False):
            file.attrs[key] = size
        for key, array in arrays.items():
            packed = {"compression": "lzf", "shuffle": True} if key in CHUNKED else {}
            chunks = (1, *array.shape[1:]) if key in CHUNKED else None
            file.create_dataset(key, data=array, chunks=chunks, **packed)
        for key, text in texts.items():
            file.create_dataset(key, data=text.tolist(), dtype=h5py.string_dtype())
        for key, array in (poses or {}).items():
            file.create_dataset(f"indenter/{key}", data=array)


def read(
    path: Path | str,
    scene: Scene | None = None,
    *,
    instead_of_raw10: Mapping[str, np.ndarray] | None = None,
) -> Dataset:
    """Read and validate the dataset in a file; with `scene`, also that size, pitch and channels are the
    scene's.

    instead_of_raw10 : `frames` (N, H, W, C) and `background` (H, W, C) uint8, the channels of the file's
        RAW10 images, which then are not read: most of the file
    Raises DatasetError on anything missing, malformed, not finite, normals that are not unit vectors, or a
    mismatch with the scene.
    """
    path = Path(path)
    try:
        hdf5_checks.check_heaps(path)
        file = h5py.File(path, "r")
    except FileNotFoundError:
        raise DatasetError(f"{path}: no such file") from None
    except PermissionError:
        raise DatasetError(f"{path}: permission denied") from None
    except UnsafeFileError as error:
        raise DatasetError(f"{path}: damaged: {error}") from None
    except (OSError, ValueError):
        raise DatasetError(f"{path}: not an HDF5 file") from None
    with file:
        try:
            content = _content(file, path, instead_of_raw10 or {})
        except DatasetError:
            raise
        except UnsafeFileError as error:
            raise DatasetError(f"{path}: {error}") from None
        except Exception as error:  # h5py raises nearly every class for what is damaged
            reason = (str(error).splitlines() or [type(error).__name__])[0]
            raise DatasetError(f"{path}: damaged: {reason}") from None
    data = Dataset(**content)
    check(data, scene, str(path))
    return data


def _content(file: h5py.File, path: Path, instead_of_raw10: Mapping[str, np.ndarray]) -> dict:
    """The arguments of `Dataset` from a file's attributes and arrays, after a check of their types; arrays
    that are given instead of RAW10 images are taken as they are."""
    attributes = {}
    kinds = {"format_version": np.integer, "pitch_mm": np.floating, "channels": str, "source": str}
    for key in kinds:
        if key not in file.attrs:
            raise DatasetError(f"{path}: {key}: missing attribute")
    counts = dict.fromkeys(("left_out", *PHOTOGRAPH), np.integer)
    for key, kind in (kinds | {"force_axes": str} | counts).items():
        if key not in file.attrs:
            continue
        check_attribute(file.attrs, key, path)
        value = file.attrs[key]
        if not isinstance(value, kind):
            raise DatasetError(f"{path}: {key} = {value!r}: expected {kind.__name__}")
        if kind is str and not value.isprintable():
            raise DatasetError(f"{path}: {key} = {value!r}: expected text in one line")
        attributes[key] = value
    if attributes["format_version"] != FORMAT_VERSION:
        raise DatasetError(
            f"{path}: format_version = {attributes['format_version']}: expected {FORMAT_VERSION}"
        )
    known = {field.name for field in fields(Dataset)}
    for key in file:
        if key not in known:
            raise DatasetError(f"{path}: {key if key.isprintable() else ascii(key)}: unknown key")
        check_link(file, key)
    content = {
        "pitch_mm": float(attributes["pitch_mm"]),
        "channels": tuple(attributes["channels"].split(",")),
        "source": attributes["source"],
    }
    if "force_axes" in attributes:
        content["force_axes"] = tuple(attributes["force_axes"].split(","))
    content["left_out"] = int(attributes.get("left_out", 0))
    if all(key in attributes for key in PHOTOGRAPH):
        content["photograph_px"] = tuple(int(attributes[key]) for key in PHOTOGRAPH)
    for key in (*TEXTS, *ARRAYS):
        stored = file.get(key)
        if stored is None:
            if key in REQUIRED:
                raise DatasetError(f"{path}: {key}: missing")
            continue
        if not isinstance(stored, h5py.Dataset):
            raise DatasetError(f"{path}: {key} = a group: expected an array")
        check_array(stored, key, path)
        if key in TEXTS:
            if h5py.check_string_dtype(stored.dtype) is None:
                raise DatasetError(f"{path}: {key} = {stored.dtype}: expected text")
            content[key] = np.asarray(stored.asstr()[()], dtype=str)
            continue
        kind = np.dtype(_type(key, "raw10" in file))
        if stored.dtype != kind:
            raise DatasetError(f"{path}: {key} = {stored.dtype}: expected {kind}")
        if not instead_of_raw10 or key not in ("raw10", "background"):
            content[key] = stored[()]
    content |= instead_of_raw10
    if "indenter" in file:
        content["indenter"] = _indenter(file["indenter"], path)
    return content


def _indenter(group, path: Path) -> dict[str, np.ndarray]:
    if not isinstance(group, h5py.Group):
        raise DatasetError(f"{path}: indenter = an array: expected a group")
    poses = {}
    for key in group:
        check_link(group, key)
        stored = group[key]
        if not isinstance(stored, h5py.Dataset) or stored.dtype != np.float64:
            raise DatasetError(f"{path}: indenter/{key}: expected an array of float64")
        check_array(stored, f"indenter/{key}", path)
        poses[key] = stored[()]
    return poses
