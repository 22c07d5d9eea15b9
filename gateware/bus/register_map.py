"""The register map, from which hardware, tests, hardware.json and documentation are made."""

from typing import NamedTuple

from fastac.gateware.bus.record import FIFO_RECORDS, PLAIN, WITH_HALF_WIDTHS
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
    "results_lost",
)
"""Bits of the register ERRORS, from bit 0."""
AXES = "xyz"


class Field(NamedTuple):
    """Bit field of a register: bits `low` to `low + width − 1`."""

    name: str
    low: int
    width: int = 1


class Register(NamedTuple):
    """One 32-bit register at the byte address `offset`.

    access : ro read-only, rw read and write, w1c read and write 1 to clear, wo write-only (reads as 0)
    needs : what the hardware must have for the register to exist: "" (always), "force", "force_x" and so on,
        "half_width", "half_width_x" and so on, "depth", "normals", "slip", "calibration", or "results"
        (results in records: frames in packets)
    read_changes : reading it changes what it, or its other half, reads as next
    """

    name: str
    offset: int
    access: str
    meaning: str
    fields: tuple[Field, ...] = ()
    needs: str = ""
    read_changes: bool = False


_FORCE = [
    Register(
        f"FORCE_{axis.upper()}_{half}",
        0x50 + 8 * k + 4 * upper,
        "ro",
        meaning,
        needs=f"force_{axis}",
        read_changes=half == "LOW",
    )
    for k, axis in enumerate(AXES)
    for upper, half, meaning in (
        (0, "LOW", f"last force, axis {axis}: bits 31:0 of the raw accumulator; reading it latches HIGH"),
        (1, "HIGH", "bits 63:32, sign-extended, latched when LOW was last read"),
    )
]

_HALF_WIDTHS = [
    Register(
        f"HALF_WIDTH_{axis.upper()}_{half}",
        0xA0 + 8 * k + 4 * upper,
        "ro",
        meaning,
        needs=f"half_width_{axis}",
        read_changes=half == "LOW",
    )
    for k, axis in enumerate(AXES)
    for upper, half, meaning in (
        (
            0,
            "LOW",
            f"half the width of the interval around the force of axis {axis}, in the unit of its accumulator:"
            " bits 31:0; reading it latches HIGH",
        ),
        (1, "HIGH", "bits 63:32, latched when LOW was last read"),
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
        " first. packets: a frame and an image are one packet each, and each result is a record: the"
        " registers from TIME_LOW on exist. The others: this output or function exists",
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
            Field("packets", 26),
            Field("half_width", 27),
        ),
    ),
    Register(
        "CONTROL",
        0x18,
        "rw",
        "enable: accept frames; 1 after reset. capture_background: store the next whole frame as background;"
        " reads as 1 until that is done, and writing 0 does not cancel it. soft_reset: reset the datapath and"
        " discard the frames in it; reads as 0. interrupt_enable: drive the interrupt output with"
        " INTERRUPT_STATUS. restart_calibration: discard the words of CALIBRATION received; reads as 0."
        " clear_results: discard the records that RESULTS_WORD has not given; reads as 0",
        tuple(
            Field(name, k)
            for k, name in enumerate(
                (
                    *("enable", "capture_background", "soft_reset", "interrupt_enable"),
                    *("restart_calibration", "clear_results"),
                )
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
        " read without a register, or a write that was refused. results_lost: RESULTS_LOST has grown",
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
    Register(
        "TIME_LOW",
        0x8C,
        "ro",
        "clocks since reset, which a soft reset is not: bits 31:0; reading it latches TIME_HIGH",
        needs="results",
        read_changes=True,
    ),
    Register("TIME_HIGH", 0x90, "ro", "bits 63:32, latched when TIME_LOW was last read", needs="results"),
    Register(
        "RESULTS_WAITING",
        0x94,
        "ro",
        f"records that wait to be read from RESULTS_WORD, at most {FIFO_RECORDS}; a record counts until its"
        " last word is read",
        needs="results",
    ),
    Register(
        "RESULTS_WORD",
        0x98,
        "ro",
        f"the next 32-bit word of the oldest result's record, {len(PLAIN.words)} words a record, with"
        f" half-widths {len(WITH_HALF_WIDTHS.words)}; reading takes it. 0 if none waits."
        " A soft reset leaves the records; CONTROL.clear_results discards them",
        needs="results",
        read_changes=True,
    ),
    Register(
        "RESULTS_LOST",
        0x9C,
        "ro",
        f"results since reset that came while {FIFO_RECORDS} records waited, and were not kept",
        needs="results",
    ),
    *_HALF_WIDTHS,
    Register(
        "HALF_WIDTH_SEQUENCE",
        0xB8,
        "ro",
        "number of the frame of the half-widths, from 1; 0: none yet. They come a few clocks after the force:"
        " if FORCE_SEQUENCE reads the same before and after the registers of force and half-widths are read,"
        " and this as well, all belong to one frame",
        needs="half_width",
    ),
)
