"""Frame files of a machine's recording: one file per sample in a folder.

000012.raw      RAW10 image, packed as the camera sends it (sensor/optics/raw10.py)
000012.npy      RAW10 image unpacked, uint16 (rows, columns); or channels, uint8 (H, W, C) in scene order
000012.png      channels as an RGB image; where the scene has NIR, with the 8-bit grey 000012.nir.png

`background` in place of the number is the no-contact reference frame. RAW10 images larger than the window of
4 × 4 raw pixels per pixel are cropped to their centre.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fastac.scenes.sensor_schema import Sensor
from fastac.sensor.importers.cad import read_array
from fastac.sensor.importers.footage import ImportFailure, file_in, photograph, pixels
from fastac.sensor.optics.mosaic import CELL, MosaicError, window
from fastac.sensor.optics.raw10 import Raw10Error, pack, unpack

BACKGROUND = "background"
SUFFIXES = {"raw10": (".raw", ".npy"), "channels": (".npy", ".png")}


def stem(index: int) -> str:
    """The file name, without suffix, of the sample with this index."""
    return f"{index:06d}"


@dataclass(frozen=True)
class CncFrames:
    """Reads and writes the frames of one scene's sensor in a folder."""

    folder: Path
    sensor: Sensor
    raw_size_px: tuple[int, int] | None = None
    """Height and width of packed RAW10 images; None: those of the window."""

    def read(self, name: str) -> np.ndarray:
        """Read a frame: RAW10 (4H, 4W) uint16, or channels (H, W, C) uint8, as the scene's sensor sends them.

        Raises ImportFailure where it is missing, of another size or type, or truncated.
        """
        suffixes = SUFFIXES[self.sensor.frames]
        for suffix in suffixes:
            path = file_in(self.folder, name + suffix)
            if path.is_file():
                return self._raw(path) if self.sensor.frames == "raw10" else self._channels(path)
        raise ImportFailure(f"{self.folder / name}: no such file: expected {' or '.join(suffixes)}")

    def _raw(self, path: Path) -> np.ndarray:
        kept_px = CELL * self.sensor.height_px, CELL * self.sensor.width_px
        try:
            if path.suffix == ".npy":
                raw = read_array(path)
                if raw.dtype != np.uint16 or raw.ndim != 2:
                    raise ImportFailure(f"{path}: {raw.dtype} {raw.shape}: expected uint16 (rows, columns)")
            else:
                raw = unpack(path.read_bytes(), *(self.raw_size_px or kept_px))
            rows, columns = window(*raw.shape, kept_px)
        except (Raw10Error, MosaicError, ValueError) as error:
            raise ImportFailure(str(error) if str(path) in str(error) else f"{path}: {error}") from None
        if raw.shape[0] % CELL or raw.shape[1] % CELL:
            raise ImportFailure(f"{path}: {raw.shape[1]} x {raw.shape[0]} px: expected multiples of {CELL}")
        if raw.max() > 2**10 - 1:
            raise ImportFailure(f"{path}: a pixel is {raw.max()}: expected at most {2**10 - 1}")
        return raw[rows, columns]

    def _channels(self, path: Path) -> np.ndarray:
        frame = read_array(path) if path.suffix == ".npy" else self._photographs(path)
        want = (self.sensor.height_px, self.sensor.width_px, len(self.sensor.channel_names))
        if frame.dtype != np.uint8 or frame.shape != want:
            raise ImportFailure(f"{path}: {frame.dtype} {frame.shape}: expected uint8 {want}")
        return frame

    def _photographs(self, path: Path) -> np.ndarray:
        colours = photograph(path)
        if self.sensor.channels == "bgr":
            return colours
        beside = path.with_suffix(".nir.png")
        if not beside.exists():
            raise ImportFailure(f"{beside}: no such file, and the scene has NIR")
        nir = pixels(file_in(self.folder, beside.name), "L", "an 8-bit grey image")
        if nir.shape != colours.shape[:2]:
            raise ImportFailure(f"{beside}: size = {nir.shape}: expected that of {path.name}")
        return np.dstack([colours, nir])

    def write(self, name: str, frame: np.ndarray) -> None:
        """Write a frame: packed RAW10, or an array of channels."""
        if self.sensor.frames == "raw10":
            (self.folder / f"{name}.raw").write_bytes(pack(frame).tobytes())
        else:
            np.save(self.folder / f"{name}.npy", frame)
