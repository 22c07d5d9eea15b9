"""What the hardware says of itself: `hardware.json` beside its Verilog, checked before it is driven by it.

Layouts in memory follow from the frame's size, the pixels per beat and the words per pixel. For streams =
"packets" the file states them, too, and both must agree. For streams = "video" no DMA takes the streams; the
layouts are then those of the packets that the simulation makes of them (sim/board/bench.py).
"""

import math
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from fastac.gateware.bus.record import RECORD_BYTES, RecordForm, record_form
from fastac.gateware.packet_format import FrameFormat, PacketFormat

FILE = "hardware.json"
FORMAT_VERSION = 1
SHOWN = 60
"""Characters of a wrong value that an error shows."""

Count = Annotated[int, Field(ge=1)]
Bytes = Annotated[int, Field(ge=0)]
Scale = Annotated[float, Field(gt=0)]


class DescriptionError(ValueError):
    """A hardware.json that cannot be used; the message is one line that names file, key and value."""


class _Table(BaseModel):
    """Keys that the driver does not use are left alone; those that it uses must have the right type."""

    model_config = ConfigDict(extra="ignore", frozen=True, strict=True, allow_inf_nan=False)


class FieldFacts(_Table):
    """Bits `low` to `low + width - 1` of a register."""

    name: str
    low: Annotated[int, Field(ge=0, le=31)]
    width: Annotated[int, Field(ge=1, le=32)] = 1


class RegisterFacts(_Table):
    """One 32-bit register at the byte address `offset`."""

    name: str
    offset: Annotated[int, Field(ge=0, multiple_of=4)]
    access: Literal["ro", "rw", "w1c", "wo"]
    fields: tuple[FieldFacts, ...] = ()
    reset: int | None = None
    """Value after reset; None where it is not constant."""


class FrameFacts(_Table):
    """The frame as it is sent: H × W pixels of the named channels, `lanes` pixels a beat."""

    height_px: Count
    width_px: Count
    channels: Annotated[tuple[str, ...], Field(min_length=1)]
    lanes: Count
    bytes_per_pixel: int | None = None
    bytes_per_beat: int | None = None
    bytes: int | None = None

    @property
    def shape(self) -> tuple[int, int, int]:
        """(H, W, C)."""
        return self.height_px, self.width_px, len(self.channels)

    @cached_property
    def format(self) -> FrameFormat:
        """Layout in memory. Raises ValueError for lanes that no layout has."""
        return FrameFormat(self.height_px, self.width_px, len(self.channels), self.lanes)


class OutputFacts(_Table):
    """An image output's packets: rows of beats of `lanes` pixels, each padded to a power of two of 32-bit
    words; then the frame's record, in whole beats."""

    name: str
    rows: Count
    columns: Count
    words_per_pixel: Count
    lanes: Count
    rows_reversed: bool
    unit: str
    per_lsb: Scale | tuple[Scale, ...] | dict[str, Scale] | None
    complete: bool | None = None
    record_bytes: Count = RECORD_BYTES
    words_per_pixel_padded: int | None = None
    beats_per_row: int | None = None
    bytes_per_beat: int | None = None
    row_bytes: int | None = None
    image_bytes: int | None = None
    packet_bytes: int | None = None
    trailer_offset_bytes: int | None = None

    @cached_property
    def format(self) -> PacketFormat:
        """Layout of a packet. Raises ValueError for lanes that no layout has."""
        shape = self.rows, self.columns, self.words_per_pixel, self.lanes
        return PacketFormat(self.name, *shape, self.record_bytes)

    @property
    def layout(self) -> dict[str, int]:
        """The keys of hardware.json that follow from the others."""
        found = self.format
        return {
            "words_per_pixel_padded": found.words_padded,
            "beats_per_row": found.beats_per_row,
            "bytes_per_beat": found.bytes_per_beat,
            "row_bytes": found.row_bytes,
            "image_bytes": found.image_bytes,
            "packet_bytes": found.packet_bytes,
            "trailer_offset_bytes": found.image_bytes,
        }


class ResultsFacts(_Table):
    """The records: their size, and the port that carries nothing but them, if there is one."""

    record_bytes: int
    format: int
    port: str | None


class ForceFacts(_Table):
    """Axes of the force that the hardware finds, and newtons of one unit of each raw accumulator."""

    axes: tuple[Literal["x", "y", "z"], ...]
    newtons_per_lsb: dict[str, Scale]

    @cached_property
    def scales(self) -> np.ndarray:
        """(axes,), in N."""
        return np.array([self.newtons_per_lsb[axis] for axis in self.axes])


class IntervalFacts(_Table):
    """The interval around each force, force ± half-width, and the share of forces that it is to cover."""

    coverage: Annotated[float, Field(gt=0, lt=1)]


class SlipFacts(_Table):
    """The spread of the dots in contact."""

    unit: str


class Description(_Table):
    """All that a driver must know of the hardware. `read` makes one of a file."""

    format_version: int
    version: int
    scene: str
    clock_mhz: Scale
    streams: Literal["video", "packets"]
    bundle_sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
    frame: FrameFacts
    outputs: tuple[OutputFacts, ...]
    force: ForceFacts | None
    interval: IntervalFacts | None = None
    slip: SlipFacts | None
    registers: Annotated[tuple[RegisterFacts, ...], Field(min_length=1)]
    errors: tuple[str, ...]
    validity: tuple[str, ...]
    latency_cycles_by_formula: dict
    results: ResultsFacts | None = None
    part: str | None = None

    def require_bundle(self, digest: str, origin: str) -> None:
        """Raise DescriptionError, naming `origin`, unless the hardware is of the bundle with this hash."""
        if self.bundle_sha256 != digest:
            raise DescriptionError(
                f"{origin}: bundle_sha256 = {self.bundle_sha256[:16]}…: the bundle's is {digest[:16]}…;"
                " write it again with fastac verilog BUNDLE"
            )

    @property
    def hash_word(self) -> int:
        """The first 64 bits of the bundle's hash, as the registers BUNDLE_HASH have them."""
        return int(self.bundle_sha256[:16], 16)

    @property
    def has_packets(self) -> bool:
        """Whether stock DMAs can take the streams."""
        return self.streams == "packets"

    @property
    def record(self) -> RecordForm:
        """The layout of the records."""
        return record_form(self.interval is not None)

    @cached_property
    def streams_out(self) -> dict[str, int]:
        """Output streams in the order of their DMAs, and the bytes of a packet of each.

        Scenes without an image have the stream `results`, whose packets are records.
        """
        found = {output.name: output.format.packet_bytes for output in self.outputs}
        return found or {"results": self.record.bytes}

    @cached_property
    def record_at(self) -> tuple[str, int] | None:
        """The stream whose packets hold the frame's whole record, and its place in them in bytes.

        None: no packet waits for the result; the records are read from the registers.
        """
        if not self.outputs:
            return "results", 0
        return next(((o.name, o.format.image_bytes) for o in self.outputs if self.completes(o)), None)

    def completes(self, output: OutputFacts) -> bool:
        """Whether the output's packets hold the whole record; with video streams all do."""
        return not self.has_packets or bool(output.complete)

    @property
    def result_cycles(self) -> int:
        """Clocks from a frame's first beat to its result, by the formulas of the stages."""
        latency = self.latency_cycles_by_formula
        names = [f"first_pixel_to_{name}" for name in ("force", "depth", "normals")]
        return int(next((latency[name] for name in names if name in latency), self.frame_beats))

    @property
    def frame_beats(self) -> int:
        """Beats of a frame."""
        return self.frame.format.beats


def read(path: Path | str) -> Description:
    """The description in a file, or in the folder of the Verilog that it belongs to.

    Raises DescriptionError where there is none, it is damaged, or its values contradict each other.
    """
    path = Path(path)
    path = path if path.suffix == ".json" else path / FILE
    try:
        text = path.read_bytes()
    except OSError as error:
        hint = "; write it with fastac verilog BUNDLE" if isinstance(error, FileNotFoundError) else ""
        raise DescriptionError(f"{path}: {error.strerror or error}{hint}") from None
    return parse(text, str(path))


def parse(text: bytes | str, origin: str = FILE) -> Description:
    """The description in a JSON text; `origin` names it in errors, which are DescriptionErrors."""
    try:
        found = Description.model_validate_json(text)
    except ValidationError as error:
        raise DescriptionError(f"{origin}: {_first(error)}") from None
    problem = _contradiction(found)
    if problem:
        raise DescriptionError(f"{origin}: {problem}")
    return found


def _first(error: ValidationError) -> str:
    """The first thing wrong, in one line; a missing key first, since older files lack many."""
    errors = error.errors(include_url=False)
    first = next((found for found in errors if found["type"] == "missing"), errors[0])
    key = ".".join(str(part) for part in first["loc"])
    if first["type"] == "missing":
        return f"{key}: missing; if an older version wrote it, write it again with fastac verilog BUNDLE"
    value = " ".join(repr(first["input"]).split())
    value = value if len(value) <= SHOWN else f"{value[:SHOWN]}…"
    return f"{key} = {value}: {first['msg']}" if key else f"damaged or no JSON ({first['msg']})"


def _contradiction(found: Description) -> str | None:
    """The first value that cannot be right, as `key = value: expected …`."""

    def wrong(key: str, have, want) -> str | None:
        return None if have == want else f"{key} = {have!r}: expected {want!r}"

    checks = [wrong("format_version", found.format_version, FORMAT_VERSION)]
    frame, packets = found.frame, found.has_packets
    try:
        form = frame.format
        _ = [output.format for output in found.outputs]
    except ValueError as error:
        return str(error)
    if packets:
        checks += [f"outputs.{o.name}.complete: missing" for o in found.outputs if o.complete is None]
        checks += [
            wrong(f"frame.{key}", getattr(frame, key), getattr(form, key))
            for key in ("bytes_per_pixel", "bytes_per_beat", "bytes")
        ]
        if found.results is None:
            checks.append("results: missing")
        else:
            checks += [
                wrong("results.record_bytes", found.results.record_bytes, found.record.bytes),
                wrong("results.format", found.results.format, found.record.number),
            ]
    checks += [
        wrong(f"outputs.{o.name}.record_bytes", o.record_bytes, found.record.bytes) for o in found.outputs
    ]
    for output in found.outputs if packets else ():
        checks += [
            wrong(f"outputs.{output.name}.{key}", getattr(output, key), value)
            for key, value in output.layout.items()
        ]
    if found.interval is not None and found.force is None:
        checks.append("interval: expected a force, around which it is")
    if found.force is not None:
        axes = found.force.axes
        if set(axes) != found.force.newtons_per_lsb.keys() or len(set(axes)) != len(axes):
            checks.append(f"force.newtons_per_lsb: expected the axes {', '.join(axes)}, each once")
    for kind, names in (
        ("registers", [register.name for register in found.registers]),
        ("registers: offsets", [register.offset for register in found.registers]),
        ("outputs", [output.name for output in found.outputs]),
    ):
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            checks.append(f"{kind}: {twice!r} is there twice")
    if not (math.isfinite(found.clock_mhz) and all(_counts(found))):
        checks.append("latency_cycles_by_formula: expected counts of clocks")
    return next((problem for problem in checks if problem), None)


def _counts(found: Description) -> list[bool]:
    """Of each latency that the driver uses, whether it is a count."""
    latency = found.latency_cycles_by_formula
    return [isinstance(value, int) and value > 0 for key, value in latency.items() if key != "stage"]
