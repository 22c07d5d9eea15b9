"""The map of the registers, for the hardware, the host's driver and the documentation alike."""

from dataclasses import dataclass
from typing import NamedTuple

from fastac.models.integer.frame_validity import REASONS

ADDRESS_WIDTH = 8
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
)
AXES = "xyz"


class Field(NamedTuple):
    """Bits `low` to `low + width − 1` of a register."""

    name: str
    low: int
    width: int = 1


class Register(NamedTuple):
    """One 32-bit register. `access`: ro read, rw read and write, w1c read and write 1 to clear, wo
    write, and read as 0.

    `needs` is what the hardware must give for the register to exist: "", force, an axis of it, depth,
    normals or calibration.
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
        (0, "LOW", f"{axis} of the last force, raw accumulator, bits 31:0; reading it holds its HIGH"),
        (1, "HIGH", "bits 63:32, sign-extended, of what LOW was when it was last read"),
    )
]

REGISTERS = (
    Register("ID", 0x00, "ro", f"{ID:#010x}, the text FTAC"),
    Register("VERSION", 0x04, "ro", "version of the hardware and of this map"),
    Register(
        "BUNDLE_HASH_LOW", 0x08, "ro", "bits 31:0 of the bundle's hash; both are 0 while STATUS.loading"
    ),
    Register("BUNDLE_HASH_HIGH", 0x0C, "ro", "bits 63:32 of the bundle's hash"),
    Register("GEOMETRY", 0x10, "ro", "pixels", (Field("height", 0, 16), Field("width", 16, 16))),
    Register(
        "CAPABILITIES",
        0x14,
        "ro",
        "channels a pixel, pixels a beat, and what else there is; rows_reversed: depth and force map leave"
        " last row first",
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
        ),
    ),
    Register(
        "CONTROL",
        0x18,
        "rw",
        "enable: let frames in, 1 after reset. capture_background: take the next whole frame as background,"
        " 0 again when that is done and not before; writing 0 changes nothing. soft_reset: reset datapath and"
        " forget the frames in it, reads as 0. interrupt_enable: pass INTERRUPT_STATUS on to the interrupt."
        " restart_calibration: the next word of CALIBRATION is a first one again, reads as 0",
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
        "busy: frames are in flight. result_valid: a result has come since reset or soft reset."
        " last_frame_bad: the frame of the last result was bad. loading: a calibration is not complete, and"
        " frames wait. last_frame_suspect: FRAME_VALIDITY is not 0. frames_in_flight: how many",
        (
            Field("busy", 0),
            Field("result_valid", 1),
            Field("last_frame_bad", 2),
            Field("loading", 3),
            Field("last_frame_suspect", 4),
            Field("frames_in_flight", 8, 8),
        ),
    ),
    Register(
        "ERRORS",
        0x20,
        "w1c",
        "what happened since it was cleared. result_overrun: a result came while the last one's interrupt was"
        " still pending. calibration_refused: a word of CALIBRATION was. frame_suspect: a frame had a"
        " FRAME_VALIDITY other than 0",
        tuple(Field(name, k) for k, name in enumerate(ERRORS)),
    ),
    Register("INTERRUPT_STATUS", 0x24, "w1c", "a result has come", (Field("result", 0),)),
    Register("FRAME_COUNT", 0x28, "ro", "frames received since reset"),
    Register("FRAME_ERRORS", 0x2C, "ro", "bad ones among them"),
    Register("INTERVAL", 0x30, "ro", "clocks between the first beats of the last two frames"),
    Register("LATENCY_FIRST_PIXEL_TO_FORCE", 0x34, "ro", "clocks, of the last force", needs="force"),
    Register("LATENCY_LAST_PIXEL_TO_FORCE", 0x38, "ro", "clocks, of the last force", needs="force"),
    Register("LATENCY_FIRST_PIXEL_TO_DEPTH", 0x3C, "ro", "clocks to the last beat of depth", needs="depth"),
    Register(
        "FORCE_SEQUENCE",
        0x40,
        "ro",
        "which frame gave the last force, from 1 on; 0: none yet. All axes read between two equal readings"
        " of it belong to one frame",
        needs="force",
    ),
    Register(
        "LATENCY_FIRST_PIXEL_TO_NORMALS", 0x44, "ro", "clocks to the last beat of normals", needs="normals"
    ),
    Register(
        "FRAME_VALIDITY",
        0x48,
        "ro",
        "why the frame of the last result is not to be trusted: what was beyond the limits that training set;"
        " 0: nothing. clipped: pixels at 0 or 255. brightness_…: sum of a channel's differences from the"
        " background. change: sum of all their magnitudes. detail: sum of the steps from pixel to pixel in"
        " the rows. gradient, displacement: how many saturated. A background that is captured anew is what"
        " brightness and change are measured from; limits stay. A calibration brings limits of its own",
        tuple(Field(name, k) for k, name in enumerate(REASONS)),
    ),
    *_FORCE,
    Register(
        "CALIBRATION",
        0x70,
        "wo",
        "the next word of a calibration's image. SLVERR, without effect: frames are in flight, a first word"
        " that is not CALIBRATION_LAYOUT, or not all bytes written",
        needs="calibration",
    ),
    Register(
        "CALIBRATION_LAYOUT",
        0x74,
        "ro",
        "the first word of an image for this hardware",
        needs="calibration",
    ),
    Register("CALIBRATION_WORDS", 0x78, "ro", "words of an image", needs="calibration"),
    Register(
        "CALIBRATION_RECEIVED",
        0x7C,
        "ro",
        "words received of an image that is not complete; 0: none",
        needs="calibration",
    ),
)


@dataclass(frozen=True)
class Identity:
    """What the registers say of the hardware, and which of them there are."""

    bundle_hash: int
    version: int
    height: int
    width: int
    channels: int
    lanes: int
    axes: str  # of force, in order: some of "xyz" or none
    force_width: int = 64  # bits of one raw accumulator
    depth: bool = True
    background_capture: bool = False
    normals: bool = False
    force_map: bool = False
    rows_reversed: bool = False
    calibration_words: int = 0  # of an image; 0: no calibration can be loaded
    calibration_layout: int = 0  # an image's first word

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
        ):
            if not low <= getattr(self, name) <= high:
                raise ValueError(f"{name} {getattr(self, name)}: expected {low} to {high}")
        if self.axes != "".join(axis for axis in AXES if axis in self.axes):
            raise ValueError(f"axes {self.axes!r}: expected some of {AXES!r}, in this order")
        if not self.axes and not self.depth and not self.normals:
            raise ValueError("axes '', depth False: expected a force or a depth or normals to come out")

    @property
    def result(self) -> str:
        """What counts as a frame's result: its force or, where there is none, its depth, else its normals."""
        return "force" if self.axes else "depth" if self.depth else "normals"

    @property
    def calibration(self) -> bool:
        """Whether one can be loaded."""
        return self.calibration_words > 0

    @property
    def errors(self) -> tuple[str, ...]:
        """The errors that can happen, in order."""
        return tuple(name for name in ERRORS if name != "calibration_refused" or self.calibration)

    @property
    def registers(self) -> tuple[Register, ...]:
        """The registers that exist; any other address answers DECERR."""
        present = {"", *(f"force_{axis}" for axis in self.axes)}
        present |= {"force"} if self.axes else set()
        present |= {"depth"} if self.depth else set()
        present |= {"normals"} if self.normals else set()
        present |= {"calibration"} if self.calibration else set()
        return tuple(register for register in REGISTERS if register.needs in present)
