"""What the independent benches send and expect, as plain files of hexadecimal words.

Written from the documented formats of ports and registers (docs/hardware.md, gateware/top_zynq.py and
gateware/bus/register_map.py); of the project's own benches nothing is used.

    beats.hex     a beat of s_axis a line: a digit {0, 0, tlast, tuser}, then tdata
    NAME.hex      a beat of m_axis_NAME a line: three digits {tlast, tuser[10:0]}, then tkeep, then tdata
    accesses.hex  what the host does, one after another: kind, address, mask, value (2, 2, 8 and 8 digits)
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fastac.gateware.poisson.solvers import SOLVERS
from fastac.models.integer.bundle import Bundle
from fastac.models.integer.frame_validity import OF_FORCE
from fastac.models.result import Result
from fastac.scenes.schema import Scene

WRITE, READ, AWAIT_INTERRUPT, START, AWAIT_BEATS, FINISH = range(6)
"""Kinds of accesses: a write of `value`; a read whose bits under `mask` must be `value`; the interrupt is
awaited; frames are sent from now on; all beats are awaited, and `value` more clocks; the bench ends."""
LINGER = 100
"""Clocks after the last beat in which no further one may come."""
WORD_OCTETS = 4
ALL = 0xFFFFFFFF
ENABLE, INTERRUPT_ENABLE = 1 << 0, 1 << 3
BUSY, RESULT_VALID, FRAME_BAD, LOADING, FRAME_SUSPECT, SLIP = (1 << k for k in range(6))
GRADIENT_SATURATED, DISPLACEMENT_SATURATED, SUSPECT_SEEN = 1 << 5, 1 << 6, 1 << 9
"""Bits of CONTROL, STATUS and ERRORS."""


@dataclass(frozen=True)
class Stream:
    """An output stream: `rows` × `columns` pixels of `words` values, `lanes` pixels a beat.

    tagged : tuser has the row and the frame's flags, and there is a tkeep
    """

    name: str
    rows: int
    columns: int
    words: int
    lanes: int
    tagged: bool

    @property
    def octets(self) -> int:
        """Bytes of a beat."""
        return WORD_OCTETS * self.words * self.lanes

    @property
    def payload_bits(self) -> int:
        """Bits of tdata, tlast and tuser, and of tkeep where there is one."""
        return 8 * self.octets + (12 + self.octets if self.tagged else 2)

    @property
    def per_row(self) -> int:
        """Beats of a row; lanes of the last one may be void."""
        return -(-self.columns // self.lanes)

    @property
    def per_frame(self) -> int:
        """Beats of a frame."""
        return self.rows * self.per_row


@dataclass(frozen=True)
class Stimulus:
    """What was written to a folder, as the benches have to know it.

    octets, beats, per_frame : bytes of a beat of s_axis, number of beats, and of a frame
    clean : frames at the start without any pause; later ones have pauses at random on all streams
    pace : clocks between two beats of the clean frames
    unknown_idle : between two offers all bits of the camera's payload are unknown in Icarus Verilog;
        otherwise they stay. In CXXRTL they are random.
    values : words that the output streams have to bring
    limit : clocks after which the bench gives up
    """

    octets: int
    frames: int
    beats: int
    per_frame: int
    clean: int
    pace: int
    unknown_idle: bool
    streams: tuple[Stream, ...]
    accesses: int
    values: int
    limit: int


def streams(scene: Scene) -> tuple[Stream, ...]:
    """The output streams of a scene's hardware."""
    sensor, lanes = scene.sensor, scene.lanes
    inner = (sensor.height_px - 2, sensor.width_px - 2)
    words = {"depth": 1, "force_map": len(scene.force_axes)}
    found = [Stream(name, *inner, words[name], lanes, True) for name in words if name in scene.outputs]
    if "normals" in scene.outputs:
        found.append(Stream("normals", sensor.height_px, sensor.width_px, 3, lanes, False))
    return tuple(found)


def _expected(stream: Stream, scene: Scene, result: Result) -> Iterable[str]:
    """The lines of a stream's file."""
    images = {
        "depth": lambda: result.depth_words[..., None],
        "force_map": lambda: np.moveaxis(result.force_map_raw, 1, -1),
        "normals": lambda: result.normal_words,
    }[stream.name]()
    frames, padding = len(images), stream.per_row * stream.lanes - stream.columns
    reverse = stream.tagged and scene.wants_solver and SOLVERS[scene.poisson.solver].last_row_first
    rows = list(range(stream.rows))[:: -1 if reverse else 1]
    padded = np.pad(images[:, rows], ((0, 0), (0, 0), (0, padding), (0, 0)))
    beats = padded.astype("<i4").reshape(frames, stream.rows, stream.per_row, -1)
    octets = beats.view(np.uint8)[..., ::-1]  # the highest byte is written first
    suspect = (result.validity & ~OF_FORCE) != 0
    digits = stream.octets // 4
    for frame in range(frames):
        for place, row in enumerate(rows):
            for k in range(stream.per_row):
                last = k == stream.per_row - 1
                user = int(place == 0 and k == 0)
                if stream.tagged:
                    user |= row << 2 | int(suspect[frame]) << 10
                kept = stream.octets - (padding * stream.words * WORD_OCTETS if last else 0)
                keep = (1 << kept) - 1
                yield f"{last << 11 | user:03x}{keep:0{digits}x}{octets[frame, place, k].tobytes().hex()}"


def _beats(frames: np.ndarray, lanes: int) -> Iterable[str]:
    """The lines of the camera's file: frames (frames, H, W, C) uint8."""
    count, height, width, channels = frames.shape
    octets = frames.reshape(count, height * width // lanes, lanes * channels)[..., ::-1]
    per_row = width // lanes
    for frame in octets:
        for k, beat in enumerate(frame):
            yield f"{(k % per_row == per_row - 1) << 1 | (k == 0):x}{beat.tobytes().hex()}"


def _accesses(
    bundle: Bundle, result: Result, address: Mapping[str, int], latency: int | None, clean: int
) -> Iterable[tuple[int, int, int, int]]:
    """What the host does: identity, frames, the registers of each result, and what stands at the end."""
    scene = bundle.scene
    height, width = scene.sensor.height_px, scene.sensor.width_px

    def read(name: str, value: int, mask: int = ALL) -> tuple[int, int, int, int]:
        return READ, address[name], mask, value & ALL & mask

    yield read("ID", int.from_bytes(b"FTAC", "big"))
    yield read("BUNDLE_HASH_LOW", bundle.hash_word)
    yield read("BUNDLE_HASH_HIGH", bundle.hash_word >> 32)
    yield read("GEOMETRY", width << 16 | height)
    yield WRITE, address["CONTROL"], ALL, ENABLE | INTERRUPT_ENABLE
    yield read("CONTROL", ENABLE | INTERRUPT_ENABLE)
    yield START, 0, 0, 0
    for k, validity in enumerate(result.validity.tolist()):
        yield AWAIT_INTERRUPT, 0, 0, 0
        for column, axis in enumerate(scene.force_axes):
            force = int(result.force_raw[k, column])
            yield read(f"FORCE_{'XYZ'[axis]}_LOW", force)
            yield read(f"FORCE_{'XYZ'[axis]}_HIGH", force >> 32)
        if scene.wants_slip:
            yield read("SLIP_SPREAD", int(result.slip_words[k]))
            yield read("SLIP_DOTS", int(result.slip_dots[k]))
        yield read("FRAME_VALIDITY", validity)
        flags = RESULT_VALID | (FRAME_SUSPECT if validity else 0)
        flags |= SLIP if scene.wants_slip and result.slipping[k] else 0
        yield read("STATUS", flags, RESULT_VALID | FRAME_BAD | LOADING | FRAME_SUSPECT | SLIP)
        if scene.force_axes:
            yield read("FORCE_SEQUENCE", k + 1)
            if k < clean:
                yield read("LATENCY_FIRST_PIXEL_TO_FORCE", latency)
        yield WRITE, address["INTERRUPT_STATUS"], ALL, 1
    yield AWAIT_BEATS, 0, 0, LINGER
    errors = GRADIENT_SATURATED if scene.wants_slopes and np.any(result.gradient_saturated) else 0
    displacements = bundle.pipeline.validity.displacements
    errors |= DISPLACEMENT_SATURATED if displacements and np.any(result.displacement_saturated) else 0
    errors |= SUSPECT_SEEN if result.validity.any() else 0
    yield read("ERRORS", errors)
    yield read("FRAME_COUNT", len(result.validity))
    yield read("FRAME_ERRORS", 0)
    yield read("STATUS", 0, BUSY)
    yield FINISH, 0, 0, 0


def write(
    folder: Path,
    bundle: Bundle,
    frames: np.ndarray,
    result: Result,
    address: Mapping[str, int],
    *,
    latency: int,
    clean: int = 1,
    unknown_idle: bool = False,
) -> Stimulus:
    """Write the files for `frames` (frames, H, W, C) and what the integers find in them to `folder`.

    address : of the registers, by name; latency : clocks from a frame's first beat to its result
    clean, unknown_idle : see `Stimulus`
    """
    scene = bundle.scene
    lanes = scene.lanes
    folder.mkdir(parents=True, exist_ok=True)

    def put(name: str, lines: Iterable[str]) -> int:
        text = list(lines)
        (folder / f"{name}.hex").write_text("\n".join(text) + "\n")
        return len(text)

    beats = put("beats", _beats(frames, lanes))
    outputs = streams(scene)
    for stream in outputs:
        put(stream.name, _expected(stream, scene, result))
    accesses = _accesses(bundle, result, address, latency, clean)
    count = put("accesses", (f"{a:02x}{b:02x}{c:08x}{d:08x}" for a, b, c, d in accesses))
    return Stimulus(
        octets=lanes * frames.shape[-1],
        frames=len(frames),
        beats=beats,
        per_frame=beats // len(frames),
        clean=clean,
        pace=scene.fold,
        unknown_idle=unknown_idle,
        streams=outputs,
        accesses=count,
        values=sum(s.rows * s.columns * s.words for s in outputs) * len(frames),
        limit=3 * (latency + beats * scene.fold) + 5000,
    )
