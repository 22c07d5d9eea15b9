"""A scene that a search has found, written as a TOML file for `fastac build`."""

from collections.abc import Sequence
from pathlib import Path

import tomli_w

from fastac.scenes import schema as scenes
from fastac.scenes.schema import Scene
from fastac.store.files import write_text

SHOWN = ("height_px", "width_px", "pitch_mm", "channels", "source")
"""Keys of the sensor that are written even where they have their defaults: a reader looks for them first."""


def write(content: dict, path: Path, comments: Sequence[str]) -> Scene:
    """Write the scene with the JSON `content`, named after the file, below lines of comment; returns it."""
    known = Scene.model_validate(content | {"name": "written"})
    chosen = known.model_dump(mode="json", exclude={"name"}, exclude_defaults=True)
    sensor = {name: content["sensor"][name] for name in SHOWN} | chosen["sensor"]
    text = "\n".join(f"# {line}" for line in comments) + "\n" + tomli_w.dumps(chosen | {"sensor": sensor})
    write_text(path, text)
    return scenes.load(path)
