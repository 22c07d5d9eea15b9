"""The card of a bundle: what the sensor is, what it was trained on, how large its errors are, its licence."""

from importlib.metadata import version
from pathlib import Path

import h5py
import numpy as np

from fastac.models.integer.bundle import Bundle, bundle_folder
from fastac.report import build_files
from fastac.report.tables import markdown_table, number
from fastac.scenes.outputs import measured
from fastac.store.files import DamagedFileError, read_json

ADAPTED_FROM = "adapted_from_sha256"
"""In a bundle's provenance: the hash of the bundle that it was adapted from, if it was (flow/adapt.py)."""
NOT_STATED = "not stated"
DATA, ACCURACY, REPORT = "data.h5", "accuracy.json", "report.json"


def card_of(path: Path, bundle: Bundle, licence: str | None = None) -> dict:
    """The card of the bundle in a folder, as JSON can express it; what is not known is absent.

    path : the bundle's folder or its build folder, where `data.h5` and `accuracy.json` are looked for
    licence : an SPDX expression, or None for "not stated"
    Raises ValueError, in one line, for a file of the build that is damaged.
    """
    scene = bundle.scene
    build = bundle_folder(path).parent if bundle_folder(path).name == "bundle" else path
    errors = _errors(build, bundle.digest)
    return {
        "name": scene.name,
        "bundle_sha256": bundle.digest,
        "fastac_version": version("fastac"),
        "licence": licence or NOT_STATED,
        "outputs": measured(scene.outputs),
        "sensor": _sensor(bundle),
        "training_data": _training_data(build / DATA, bundle),
        **({"errors": errors} if errors else {}),
    }


def _sensor(bundle: Bundle) -> dict:
    sensor = bundle.scene.sensor
    shape = {}
    if sensor.geometry == "fingertip":
        shape["semi_axes_mm"] = list(sensor.ellipsoid.semi_axes_mm)
    if sensor.markers is not None:
        shape["dot_spacing_mm"] = sensor.markers.spacing_mm
    return {
        "geometry": sensor.geometry,
        **shape,
        "height_px": sensor.height_px,
        "width_px": sensor.width_px,
        "pitch_mm": sensor.pitch_mm,
        "channels": list(sensor.channel_names),
        "frames": sensor.frames,
    }


def _training_data(data: Path, bundle: Bundle) -> dict:
    """Source and numbers of frames, as the bundle remembers them; from the dataset, if it is there, also the
    frames of each split, the recordings, and the diameters of the balls."""
    known = bundle.pipeline.provenance
    found: dict = {"frames_are": bundle.scene.sensor.source}
    found |= {key: known[key] for key in ("source", "frames", ADAPTED_FROM) if key in known}
    if not data.exists():
        return found
    try:
        with h5py.File(data) as file:
            splits, counts = np.unique(file["split"].asstr()[:], return_counts=True)
            found["frames_of_split"] = dict(zip(splits.tolist(), counts.tolist(), strict=True))
            if "group" in file:
                found["recordings"] = sorted(set(file["group"].asstr()[:]))
            if "indenter/ball_mm" in file:
                balls = file["indenter/ball_mm"][:]
                found["balls_mm"] = np.unique(balls[np.isfinite(balls)]).tolist()
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise DamagedFileError(f"{data}: {' '.join(str(error).split())}") from None
    return found


def _errors(build: Path, digest: str) -> dict | None:
    """The errors that the build found for this very bundle, if it has any."""
    if not (build / ACCURACY).exists():
        return None
    if (build / REPORT).exists():
        report = read_json(build / REPORT)
        if isinstance(report, dict) and report.get("bundle_sha256") != digest:
            return None
    found = build_files.read(build, ACCURACY)
    return {"split": "test", **{key: found[key] for key in ("frames", "float", "integer")}}


def markdown(card: dict) -> str:
    """The card as a page to read."""
    sensor, data = card["sensor"], card["training_data"]
    outputs = ", ".join(name if unit == "1" else f"{name} ({unit})" for name, unit in card["outputs"].items())
    rows = [
        ["licence", card["licence"]],
        ["outputs", outputs],
        ["geometry", _geometry(sensor)],
        ["size", f"{sensor['height_px']} × {sensor['width_px']} px, pitch {sensor['pitch_mm']:g} mm"],
        ["channels", f"{', '.join(sensor['channels'])}; frames arrive as {sensor['frames']}"],
        ["training data", _data(data)],
        ["bundle", f"sha256 {card['bundle_sha256']}"],
        ["written by", f"fastac {card['fastac_version']}"],
    ]
    text = f"# {card['name']}\n\n{markdown_table(['', ''], rows)}\n\n## Errors\n\n"
    errors = card.get("errors")
    if errors is None:
        return text + "Not known: no evaluation was beside the bundle.\n"
    rows = [
        [key, *(number(errors[kind][key]) if key in errors[kind] else "" for kind in ("float", "integer"))]
        for key in errors["integer"]
    ]
    about = f"On the {errors['frames']} {data['frames_are']} frames of the split `{errors['split']}`; the"
    about += " last word of a name is its unit.\n\n"
    return text + about + markdown_table(["error", "float models", "integers"], rows) + "\n"


def _geometry(sensor: dict) -> str:
    axes = " × ".join(f"{axis:g}" for axis in sensor.get("semi_axes_mm", ()))
    dots = f", dots {sensor['dot_spacing_mm']:g} mm apart" if "dot_spacing_mm" in sensor else ""
    return sensor["geometry"] + (f", ellipsoid of semi-axes {axes} mm" if axes else "") + dots


def _data(data: dict) -> str:
    kind, source = data["frames_are"], data.get("source", "source not known")
    parts = [source if source.startswith(kind) else f"{kind}: {source}"]
    if "frames" in data:
        parts.append(f"{data['frames']} frames")
    if ADAPTED_FROM in data:
        parts.append(f"adapted from the bundle {data[ADAPTED_FROM][:16]}…")
    if "frames_of_split" in data:
        parts.append(", ".join(f"{count} {split}" for split, count in data["frames_of_split"].items()))
    if "recordings" in data:
        parts.append(f"recordings: {', '.join(data['recordings'])}")
    if data.get("balls_mm"):
        parts.append(f"balls of {', '.join(f'{ball:g}' for ball in data['balls_mm'])} mm")
    return "; ".join(parts)
