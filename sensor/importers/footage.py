"""Recorded frames from a video file or a folder of photographs, read one at a time."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

CHANNELS = ("B", "G", "R")
SUFFIXES = (".bmp", ".jpeg", ".jpg", ".png", ".tif", ".tiff")
"""Suffixes of the files in a folder that count as photographs."""


class ImportFailure(ValueError):
    """A recording that cannot be imported; the message is one line with file, key and value."""


def photograph(path: Path) -> np.ndarray:
    """Read an RGB image file as (height, width, 3) uint8 in the order B, G, R.

    Raises ImportFailure on a missing or unreadable file, or another mode than RGB.
    """
    try:
        with Image.open(path) as image:
            if image.mode != "RGB":
                raise ImportFailure(f"{path}: mode = {image.mode}: expected an 8-bit RGB image")
            return np.asarray(image)[..., ::-1]
    except FileNotFoundError:
        raise ImportFailure(f"{path}: no such file") from None
    except (OSError, SyntaxError, Image.DecompressionBombError) as error:
        raise ImportFailure(f"{path}: not a readable image: {error}".splitlines()[0]) from None


def _by_number(path: Path) -> list:
    """Sort key that orders names by the numbers in them: frame2 before frame10."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", path.name)]


@dataclass(frozen=True)
class Photographs:
    """A folder of photographs, in the order of the numbers in their names."""

    path: Path
    files: tuple[Path, ...]

    @classmethod
    def of(cls, folder: Path) -> "Photographs":
        files = [p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and not p.name.startswith(".")]
        if not files:
            raise ImportFailure(f"{folder}: no photographs: expected files of {', '.join(SUFFIXES)}")
        return cls(folder, tuple(sorted(files, key=_by_number)))

    def index_of(self, name: str) -> int | None:
        """Index of the frame with this file name; None if it is not in the folder."""
        names = [file.name for file in self.files]
        return names.index(name) if name in names else None

    def __iter__(self) -> Iterator[np.ndarray]:
        """Every frame, (height, width, C) uint8 in the order B, G, R."""
        return map(photograph, self.files)


@dataclass(frozen=True)
class Video:
    """A video file; frames are not kept in memory, each iteration decodes it again."""

    path: Path

    def index_of(self, name: str) -> None:
        """None: the frames of a video have no names."""
        return

    def __iter__(self) -> Iterator[np.ndarray]:
        """Every frame, (height, width, C) uint8 in the order B, G, R."""
        import av  # folders of photographs do without it

        try:
            with av.open(str(self.path)) as container:
                if not container.streams.video:
                    raise ImportFailure(f"{self.path}: no video in this file")
                container.streams.video[0].thread_type = "AUTO"
                for frame in container.decode(video=0):
                    yield frame.to_ndarray(format="bgr24")
        except av.FFmpegError as error:
            raise ImportFailure(f"{self.path}: not a readable video: {error.strerror}") from None


def footage(path: Path) -> Photographs | Video:
    """The frames at `path`, a video file or a folder.

    Raises ImportFailure if it does not exist or the folder has no photographs.
    """
    if path.is_dir():
        return Photographs.of(path)
    if not path.is_file():
        raise ImportFailure(f"{path}: no such file or folder")
    return Video(path)
