"""Recorded frames from a video file or a folder of photographs, read one at a time."""

import io
import math
import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from fastac.store.files import DamagedFileError, inside

CHANNELS = ("B", "G", "R")
SUFFIXES = (".bmp", ".jpeg", ".jpg", ".png", ".tif", ".tiff")
"""Suffixes of the files in a folder that count as photographs."""

FORMATS = ("BMP", "JPEG", "PNG", "TIFF")
"""Pillow tells formats by their content, and calls programs for some others."""
MAX_RATIO = 2048
"""Most bytes of pixels that a byte of these files can become."""
MAX_FRAME_PX = 2**26
"""Of a video's frame: more is refused before memory is allocated."""
CONTAINERS = (
    *("mov", "mp4", "m4a", "3gp", "3g2", "mj2", "matroska", "webm", "avi", "mpeg", "mpegts", "mpegvideo"),
    *("ogg", "asf", "flv", "h264", "hevc", "mjpeg", "yuv4mpegpipe", "wav"),
)
"""Formats of videos, by FFmpeg's names; playlists, which name other files, are none."""
OPTIONS = {"format_whitelist": ",".join(CONTAINERS), "protocol_whitelist": "file"}


class ImportFailure(ValueError):
    """A recording that cannot be imported; the message is one line with file, key and value."""


def photograph(path: Path) -> np.ndarray:
    """Read an RGB image file as (height, width, 3) uint8 in the order B, G, R.

    Raises ImportFailure on a missing or unreadable file, or another mode than RGB.
    """
    return pixels(path, "RGB", "an 8-bit RGB image")[..., ::-1]


def pixels(path: Path, mode: str, expected: str) -> np.ndarray:
    """The values of an image file of Pillow's mode `mode`, which the words `expected` describe.

    Raises ImportFailure on a missing or unreadable file, another mode, or more pixels than it can hold.
    """
    return _decoded(path, lambda: path.stat().st_size, str(path), mode, expected)


def encoded_photograph(content: bytes, place: str) -> np.ndarray:
    """The RGB image in the bytes of a file, (height, width, 3) uint8 in the order B, G, R.

    Raises ImportFailure, which begins with `place`, for bytes that are no such image.
    """
    return _decoded(io.BytesIO(content), lambda: len(content), place, "RGB", "an 8-bit RGB image")[..., ::-1]


def _decoded(source: Path | io.BytesIO, size: Callable[[], int], place: str, mode: str, expected: str):
    """The values of an image of so many bytes; errors begin with `place`."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # Pillow warns of files that are damaged or far too large
            with Image.open(source, formats=FORMATS) as image:
                if image.mode != mode:
                    raise ImportFailure(f"{place}: mode = {image.mode}: expected {expected}")
                declared, held = image.width * image.height * len(mode), size()
                if declared > MAX_RATIO * held:
                    shape = f"{image.width} x {image.height} px"
                    raise ImportFailure(f"{place}: size = {shape}: more than its {held} bytes can hold")
                return np.asarray(image)
    except ImportFailure:
        raise
    except FileNotFoundError:
        raise ImportFailure(f"{place}: no such file") from None
    except Exception as error:  # Pillow's readers raise whatever they meet
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise ImportFailure(f"{place}: not a readable image: {reason}") from None


def check_scale(origin: Path | str, key: str, value: float) -> None:
    """Raise ImportFailure unless a length or a scale is a positive number."""
    if not (math.isfinite(value) and value > 0):
        raise ImportFailure(f"{origin}: {key} = {value:g}: expected more than 0")


def file_in(folder: Path, name: str) -> Path:
    """The path of a recording's file. Raises ImportFailure where name or link lead out of the folder."""
    try:
        return inside(folder, name)
    except DamagedFileError as error:
        raise ImportFailure(str(error)) from None


@contextmanager
def one_line(path: Path) -> Iterator[None]:
    """Raise ImportFailure where a file cannot be read in the block."""
    try:
        yield
    except DamagedFileError as error:
        raise ImportFailure(str(error)) from None
    except OSError as error:
        raise ImportFailure(f"{path}: {error.strerror or error}") from None


def by_number(path: Path) -> list:
    """Sort key that orders names by the numbers in them: frame2 before frame10."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", path.name)]


@dataclass(frozen=True)
class Photographs:
    """A folder of photographs, in the order of the numbers in their names."""

    path: Path
    files: tuple[Path, ...]

    @classmethod
    def of(cls, folder: Path) -> "Photographs":
        names = [p.name for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and p.name[0] != "."]
        files = [file_in(folder, name) for name in names]
        if not files:
            raise ImportFailure(f"{folder}: no photographs: expected files of {', '.join(SUFFIXES)}")
        return cls(folder, tuple(sorted(files, key=by_number)))

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
        with self._opened() as (container, stream):
            stream.thread_type = "AUTO"
            stream.codec_context.options = {"max_pixels": str(MAX_FRAME_PX)}
            for frame in container.decode(stream):
                yield frame.to_ndarray(format="bgr24")

    def frames_per_second(self) -> float | None:
        """The mean rate that the file states; None where it states none."""
        with self._opened() as (_, stream):
            rate = stream.average_rate
            return float(rate) if rate else None

    @contextmanager
    def _opened(self) -> Iterator[tuple]:
        """The file and its first video stream. Raises ImportFailure for whatever happens in the block."""
        import av  # folders of photographs do without it

        try:
            with av.open(f"file:{self.path}", options=OPTIONS, metadata_errors="replace") as container:
                if not container.streams.video:
                    raise ImportFailure(f"{self.path}: no video in this file")
                yield container, container.streams.video[0]
        except ImportFailure:
            raise
        except Exception as error:  # FFmpeg's own, and what PyAV meets in damaged texts and sizes
            reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
            raise ImportFailure(f"{self.path}: not a readable video: {reason}".splitlines()[0]) from None


def footage(path: Path) -> Photographs | Video:
    """The frames at `path`, a video file or a folder.

    Raises ImportFailure if it does not exist or the folder has no photographs.
    """
    if path.is_dir():
        return Photographs.of(path)
    if not path.is_file():
        raise ImportFailure(f"{path}: no such file or folder")
    return Video(path)
