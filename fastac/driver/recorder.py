"""Results to files while they come: CSV, a line a frame, and HDF5, with the images."""

import csv
import io
import time
from pathlib import Path
from typing import Protocol

import h5py
import numpy as np

from fastac.driver.description import Description
from fastac.driver.packets import Found

FLUSH_S = 0.2
"""Longest time that a result is in memory only."""
IMAGES = {"depth": ("depth_mm", "mm"), "force_map": ("force_map_n", "N"), "normals": ("normals", "1")}
UNITS = {"_s": "s", "_n": "N", "_px": "px"}
BATCH = 16
"""Frames that are written to HDF5 at once, unless FLUSH_S is over."""


class Recorder(Protocol):
    """Takes results one after another, and is closed at the end."""

    def add(self, found: Found) -> None: ...

    def close(self) -> None: ...


def numbers(description: Description) -> tuple[str, ...]:
    """Names of the columns with a number a frame; force and half-width have one for each axis."""
    axes = description.force.axes if description.force else ()
    force = tuple(f"force_{axis}_n" for axis in axes)
    if description.interval:
        force += tuple(f"force_{axis}_half_width_n" for axis in axes)
    slip = ("slip_px", "slip_dots") if description.slip else ()
    latency = ("first_pixel_to_result_s", "last_pixel_to_result_s", "host_latency_s")
    return ("frame", "time_s", *force, *slip, *latency)


def flags(description: Description) -> tuple[str, ...]:
    """Names of the columns that are true or false."""
    return ("bad", "suspect", *(("slipping",) if description.slip else ()), "lost")


def values(found: Found) -> dict[str, float | int]:
    """One frame's columns, numbers and flags."""
    description = found.description
    row: dict[str, float | int] = {}
    for name in numbers(description):
        if name.startswith("force_"):
            continue
        value = getattr(found, name)
        row[name] = int(value) if name in ("frame", "slip_dots") else float(value)
    for name, words in (("n", found.force_n), ("half_width_n", found.force_half_width_n)):
        if words is not None:
            row |= {f"force_{axis}_{name}": float(v) for axis, v in zip(found.force_axes, words, strict=True)}
    return row | {name: int(getattr(found, name)) for name in flags(description)}


class CsvRecorder:
    """A line a frame: numbers with units in their names, flags as 0 and 1, reasons and errors by name.

    Of a frame that was lost all but its number and `lost` is empty.
    """

    def __init__(self, path: Path, description: Description):
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = io.TextIOWrapper(io.FileIO(path, "w"), newline="")
        self._columns = (*numbers(description), *flags(description))
        self._writer = csv.writer(self._file)
        self._writer.writerow([*self._columns, "reasons", "errors"])
        self._flushed = 0.0

    def add(self, found: Found) -> None:
        row = values(found)
        if row["lost"]:
            row = {"frame": row["frame"], "lost": 1}
        shown = [f"{v:.9g}" if isinstance(v := row.get(name, ""), float) else v for name in self._columns]
        self._writer.writerow([*shown, " ".join(found.reasons), " ".join(found.errors)])
        if time.monotonic() - self._flushed > FLUSH_S:
            self._file.flush()
            self._flushed = time.monotonic()

    def close(self) -> None:
        self._file.close()


class Hdf5Recorder:
    """A dataset for each column, and one for each image output, all with an axis of frames first.

    Of a frame that was lost numbers are NaN or 0, and `lost` is 1. `validity` and `errors` are the registers'
    bits, whose names are attributes of theirs.
    """

    def __init__(self, path: Path, description: Description, *, images: bool, about: dict[str, str]):
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = h5py.File(path, "w", libver="latest")
        self._file.attrs.update(about)
        self._waiting: list[Found] = []
        self._flushed = time.monotonic()
        self._images = [o.name for o in description.outputs if images]
        for name in numbers(description):
            integer = name in ("frame", "slip_dots")
            self._create(name, (), np.uint32 if integer else np.float64)
        for name in flags(description):
            self._create(name, (), np.bool_)
        for name, bits in (("validity", description.validity), ("errors", description.errors)):
            self._create(name, (), np.uint32).attrs["bits"] = list(bits)
        for output in description.outputs if images else ():
            shape = (output.rows, output.columns)
            extra = {"depth": shape, "normals": (*shape, 3), "force_map": (output.words_per_pixel, *shape)}
            name, unit = IMAGES[output.name]
            self._create(name, extra[output.name], np.float32).attrs["unit"] = unit
        self._file.swmr_mode = True  # readable at any time, also after the process was killed

    def _create(self, name: str, shape: tuple[int, ...], kind: type) -> h5py.Dataset:
        chunk = (1 if shape else 1024, *shape)
        found = self._file.create_dataset(name, (0, *shape), kind, maxshape=(None, *shape), chunks=chunk)
        unit = next((unit for end, unit in UNITS.items() if name.endswith(end)), None)
        if unit:
            found.attrs["unit"] = unit
        return found

    def add(self, found: Found) -> None:
        self._waiting.append(found)
        if len(self._waiting) >= BATCH or time.monotonic() - self._flushed > FLUSH_S:
            self._write()

    def _write(self) -> None:
        if not self._waiting:
            return
        rows = [values(found) for found in self._waiting]
        columns = {
            name: [np.nan if row["lost"] and isinstance(row[name], float) else row[name] for row in rows]
            for name in rows[0]
        }
        for name in ("validity", "errors"):
            columns[name] = [int(found.records[name]) for found in self._waiting]
        for output in self._images:
            name = IMAGES[output][0]
            columns[name] = np.stack([getattr(found, name) for found in self._waiting])
        for name, column in columns.items():
            place = self._file[name]
            place.resize(len(place) + len(rows), axis=0)
            place[-len(rows) :] = column
        self._waiting.clear()
        self._file.flush()
        self._flushed = time.monotonic()

    def close(self) -> None:
        self._write()
        self._file.close()
