"""The register map, from which hardware, tests, hardware.json and documentation are made."""

from dataclasses import dataclass
from typing import NamedTuple

from fastac.models.integer.frame_validity import REASONS

ADDRESS_WIDTH = 8
"""Bits of a byte address."""
ID = int.from_bytes(b"FTAC", "big")
ERRORS = (
    "line_short",
    "line_long",
    "frame_short",
    "frame_long",
    "no_start",
    "gradient_saturated",
    "displacement_saturated",
    "result_overrun",
    "calibration_refused",
    "frame_suspect",
    "frame_timeout",
    "access_refused",
)
"""Bits of the register ERRORS, from bit 0."""
AXES = "xyz"
BUS_ERRORS = ("flag", "respond")
"""How a refused access is reported: by ERRORS.access_refused alone, or by an AXI error response too."""


class Field(NamedTuple):
    """Bit field of a register: bits `low` to `low + width − 1`."""

    name: str
    low: int
    width: int = 1


class Register(NamedTuple):
    """One 32-bit register at the byte address `offset`.

    access : ro read-only, rw read and write, w1c read and write 1 to clear, wo write-only (reads as 0)
    needs : what the hardware must have for the register to exist: "" (always), "force", "force_x" and so on,
        "depth", "normals", "slip" or "calibration"
    """

    name: str
    offset: int
    access: str
    meaning: str
    fields: tuple[Field, ...] = ()
    needs: str = ""


_FORCE = [
    Register(f"FORCE_{axis.upper()}_{half}", 0x50 + 8 * k + 4 * upper, "ro", meaning, needs=f"force_{axis}")
    for k, axis in enumerate(AXES)
    for upper, half, meaning in (
        (0, "LOW", f"last force, axis {axis}: bits 31:0 of the raw accumulator; reading it latches HIGH"),
        (1, "HIGH", "bits 63:32, sign-extended, latched when LOW was last read"),
    )
]

REGISTERS = (
    Register("ID", 0x00, "ro", f"constant {ID:#010x}, the ASCII text FTAC"),
    Register("VERSION", 0x04, "ro", "version of the hardware and of this register map"),
    Register("BUNDLE_HASH_LOW", 0x08, "ro", "bits 31:0 of the bundle's hash; 0 while STATUS.loading"),
    Register("BUNDLE_HASH_HIGH", 0x0C, "ro", "bits 63:32 of the bundle's hash; 0 while STATUS.loading"),
    Register(
        "GEOMETRY", 0x10, "ro", "frame size in pixels", (Field("height", 0, 16), Field("width", 16, 16))
    ),
    Register(
        "CAPABILITIES",
        0x14,
        "ro",
        "channels: per pixel. lanes: pixels per beat. rows_reversed: depth and force map are sent last row"
        " first. The others: this output or function exists",
        (
            Field("channels", 0, 8),
            Field("lanes", 8, 8),
            Field("force_x", 16),
            Field("force_y", 17),
            Field("force_z", 18),
            Field("depth", 19),
            Field("background_capture", 20),
            Field("normals", 21),
            Field("force_map", 22),
            Field("rows_reversed", 23),
            Field("calibration", 24),
            Field("slip", 25),
        ),
    ),
    Register(
        "CONTROL",
        0x18,
        "rw",
        "enable: accept frames; 1 after reset. capture_background: store the next whole frame as background;"
        " reads as 1 until that is done, and writing 0 does not cancel it. soft_reset: reset the datapath and"
        " discard the frames in it; reads as 0. interrupt_enable: drive the interrupt output with"
        " INTERRUPT_STATUS. restart_calibration: discard the words of CALIBRATION received; reads as 0",
        tuple(
            Field(name, k)
            for k, name in enumerate(
                ("enable", "capture_background", "soft_reset", "interrupt_enable", "restart_calibration")
            )
        ),
    ),
    Register(
        "STATUS",
        0x1C,
        "ro",
        "busy: frames are in flight. result_valid: there has been a result since reset or soft reset."
        " last_frame_bad: the input of the last result's frame was repaired. loading: a calibration"
        " is incomplete, and frames wait. last_frame_suspect: FRAME_VALIDITY is not 0. slip: SLIP_SPREAD is"
        " beyond SLIP_LIMIT; 0 without these registers. frames_in_flight: number of frames that have started"
        " and lack a result",
        (
            Field("busy", 0),
            Field("result_valid", 1),
            Field("last_frame_bad", 2),
            Field("loading", 3),
            Field("last_frame_suspect", 4),
            Field("slip", 5),
            Field("frames_in_flight", 8, 8),
        ),
    ),
    Register(
        "ERRORS",
        0x20,
        "w1c",
        "sticky error flags. line_…, frame_short, frame_long, no_start: a line or frame of the wrong length"
        " or without a start of frame. gradient_saturated, displacement_saturated: a value was clipped."
        " result_overrun: a result came while the interrupt of the previous one was pending."
        " calibration_refused: a word of CALIBRATION was refused. frame_suspect: a frame's FRAME_VALIDITY was"
        " not 0. frame_timeout: the camera stopped inside a frame for FRAME_TIMEOUT clocks. access_refused: a"
        " read without a register, or a write that was refused",
        tuple(Field(name, k) for k, name in enumerate(ERRORS)),
    ),
    Register("INTERRUPT_STATUS", 0x24, "w1c", "result: there is a new result", (Field("result", 0),)),
    Register("FRAME_COUNT", 0x28, "ro", "frames received since reset"),
    Register("FRAME_ERRORS", 0x2C, "ro", "bad frames received since reset"),
    Register("INTERVAL", 0x30, "ro", "clocks between the first beats of the last two frames"),
    Register(
        "LATENCY_FIRST_PIXEL_TO_FORCE",
        0x34,
        "ro",
        "clocks from the first beat of the last force's frame to that force",
        needs="force",
    ),
    Register(
        "LATENCY_LAST_PIXEL_TO_FORCE",
        0x38,
        "ro",
        "clocks from the last beat of the last force's frame to that force",
        needs="force",
    ),
    Register(
        "LATENCY_FIRST_PIXEL_TO_DEPTH",
        0x3C,
        "ro",
        "clocks from the first beat of a frame to the last beat of its depth, for the last depth map",
        needs="depth",
    ),
    Register(
        "FORCE_SEQUENCE",
        0x40,
        "ro",
        "number of the frame of the last force, from 1; 0: none yet. If it reads the same before and after"
        " the force registers are read, these belong to one frame",
        needs="force",
    ),
    Register(
        "LATENCY_FIRST_PIXEL_TO_NORMALS",
        0x44,
        "ro",
        "clocks from the first beat of a frame to the last beat of its normals, for the last normal map",
        needs="normals",
    ),
    Register(
        "FRAME_VALIDITY",
        0x48,
        "ro",
        "measures of the last result's frame that were outside the limits found in training, one bit each; 0:"
        " the frame is plausible. clipped: number of pixels at 0 or 255. brightness_…: sum of a channel's"
        " differences from the background. change: sum of the magnitudes of all differences. detail: sum of"
        " the magnitudes of the steps between neighbouring pixels of a row. gradient, displacement: number of"
        " saturated values. dots: number of lost marker dots."
        " Capturing a background does not change the limits; a calibration has its own",
        tuple(Field(name, k) for k, name in enumerate(REASONS)),
    ),
    Register(
        "FRAME_TIMEOUT",
        0x4C,
        "rw",
        "clocks without a beat inside a frame after which the frame is completed by padding and marked as"
        " bad; 0: never",
    ),
    *_FORCE,
    Register(
        "CALIBRATION",
        0x70,
        "wo",
        "next word of a calibration image. The write is refused if frames are in flight, if a"
        " first word is not CALIBRATION_LAYOUT, or if not all bytes are written",
        needs="calibration",
    ),
    Register(
        "CALIBRATION_LAYOUT",
        0x74,
        "ro",
        "identifier of this hardware, the first word of its calibration images",
        needs="calibration",
    ),
    Register("CALIBRATION_WORDS", 0x78, "ro", "number of words of a calibration image", needs="calibration"),
    Register(
        "CALIBRATION_RECEIVED",
        0x7C,
        "ro",
        "words received of an incomplete image; 0: none",
        needs="calibration",
    ),
    Register(
        "SLIP_SPREAD",
        0x80,
        "ro",
        "mean square of what the rigid motion that fits them best leaves of the shifts of the marker dots in"
        " contact, in px² / 4096, of the frame of the last force; 0 with fewer than three of them",
        needs="slip",
    ),
    Register("SLIP_DOTS", 0x84, "ro", "number of marker dots in contact in that frame", needs="slip"),
    Register(
        "SLIP_LIMIT",
        0x88,
        "rw",
        "SLIP_SPREAD beyond which STATUS.slip is set, in the same unit",
        needs="slip",
    ),
)


@dataclass(frozen=True)
class Identity:
    """The constants that the registers report about the hardware; they also decide which registers exist."""

    bundle_hash: int
    version: int
    height: int
    width: int
    channels: int
    lanes: int
    axes: str  # axes of the force: a subsequence of "xyz", "" without force
    force_width: int = 64  # bits of one raw accumulator
    depth: bool = True  # has a depth output
    background_capture: bool = False
    normals: bool = False
    force_map: bool = False
    rows_reversed: bool = False
    slip: bool = False  # has the spread of the touching dots, beside a force
    slip_limit: int = 0  # SLIP_LIMIT after reset
    calibration_words: int = 0  # words of a calibration image; 0: no calibration can be loaded
    calibration_layout: int = 0  # first word of an image
    frame_timeout: int = 0  # clocks, FRAME_TIMEOUT after reset
    bus_errors: str = "flag"  # a refused access: "flag" sets ERRORS.access_refused, "respond" also answers so

    def __post_init__(self):
        for name, low, high in (
            ("bundle_hash", 0, (1 << 64) - 1),
            ("version", 0, (1 << 32) - 1),
            ("height", 1, (1 << 16) - 1),
            ("width", 1, (1 << 16) - 1),
            ("channels", 1, 255),
            ("lanes", 1, 255),
            ("force_width", 1, 64),
            ("calibration_words", 0, (1 << 32) - 1),
            ("calibration_layout", 0, (1 << 32) - 1),
            ("frame_timeout", 0, (1 << 32) - 1),
            ("slip_limit", 0, (1 << 32) - 1),
        ):
            if not low <= getattr(self, name) <= high:
                raise ValueError(f"{name} {getattr(self, name)}: expected {low} to {high}")
        if self.axes != "".join(axis for axis in AXES if axis in self.axes):
            raise ValueError(f"axes {self.axes!r}: expected some of {AXES!r}, in this order")
        if self.bus_errors not in BUS_ERRORS:
            raise ValueError(f"bus_errors {self.bus_errors!r}: expected one of {BUS_ERRORS}")
        if self.slip and not self.axes:
            raise ValueError("slip True: expected axes of force, with which it is sampled")
        if not self.axes and not self.depth and not self.normals:
            raise ValueError("axes '', depth False, normals False: expected at least one output")

    @property
    def result(self) -> str:
        """The output that raises the interrupt: force; without it depth; without both normals."""
        return "force" if self.axes else "depth" if self.depth else "normals"

    @property
    def calibration(self) -> bool:
        """Whether calibrations can be loaded."""
        return self.calibration_words > 0

    @property
    def errors(self) -> tuple[str, ...]:
        """The errors that this hardware can report, in the order of ERRORS."""
        return tuple(name for name in ERRORS if name != "calibration_refused" or self.calibration)

    @property
    def registers(self) -> tuple[Register, ...]:
        """The registers of this hardware; accesses to other addresses are refused."""
        present = {"", *(f"force_{axis}" for axis in self.axes)}
        present |= {"force"} if self.axes else set()
        present |= {"depth"} if self.depth else set()
        present |= {"normals"} if self.normals else set()
        present |= {"slip"} if self.slip else set()
        present |= {"calibration"} if self.calibration else set()
        return tuple(register for register in REGISTERS if register.needs in present)
