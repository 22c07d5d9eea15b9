"""The record of one result: as the trailer of a packet, in the result FIFO and in the driver.

It has 64 bytes, or with half-widths of the intervals around each force 128: see `record_form`.

Plain Python: the driver reads records by it, and the hardware makes them by it.
"""

import enum
from dataclasses import dataclass

import numpy as np

RECORD_WORDS = (
    "FRAME",
    "FLAGS",
    "VALIDITY",
    "ERRORS",
    "TIME_LOW",
    "TIME_HIGH",
    "FIRST_TO_RESULT",
    "LAST_TO_RESULT",
    "FORCE_X_LOW",
    "FORCE_X_HIGH",
    "FORCE_Y_LOW",
    "FORCE_Y_HIGH",
    "FORCE_Z_LOW",
    "FORCE_Z_HIGH",
    "SLIP_SPREAD",
    "SLIP_DOTS",
)
"""The 32-bit words of a record, from word 0; little-endian bytes in memory.

FRAME : number of the frame, from 1 since hard reset, as in the register FORCE_SEQUENCE
FLAGS : see `RecordFlag`; bits 15:8: `RECORD_FORMAT`
VALIDITY : the frame's FRAME_VALIDITY
ERRORS : the register ERRORS when the result was there, what this very result set included
TIME_LOW, TIME_HIGH : clocks from hard reset to the acceptance of the frame's first beat
FIRST_TO_RESULT, LAST_TO_RESULT : clocks from the frame's first and last beat to the result
FORCE_… : raw accumulators, signed(64); 0 for an axis that the hardware does not find, see CAPABILITIES
SLIP_SPREAD, SLIP_DOTS : as in the registers of these names; 0 without slip
"""
WORD_BITS = 32
RECORD_BYTES = len(RECORD_WORDS) * WORD_BITS // 8
FIFO_RECORDS = 16
"""Records that wait for the host in the hardware at most; see gateware/bus/result_fifo.py."""
RECORD_FORMAT = 1
"""Number of this layout, in every record."""
FORMAT_LOW = 8
"""The lowest bit of the 8-bit format in FLAGS."""


class RecordFlag(enum.IntFlag):
    """Bits of the word FLAGS."""

    BAD = 1 << 0
    """The frame was repaired: its input was faulty."""
    SUSPECT = 1 << 1
    """VALIDITY is not 0."""
    SLIP = 1 << 2
    """SLIP_SPREAD was beyond SLIP_LIMIT."""
    COMPLETE = 1 << 3
    """The record holds the frame's result. Without it only FRAME, TIME, bad, aborted and the format count.

    A trailer of normals has none where the force or the depth of the same frame is not known yet."""
    ABORTED = 1 << 4
    """A soft reset cut the frame."""


@dataclass(frozen=True)
class RecordForm:
    """A layout of records: the number that is in each of them, and the names of its words."""

    number: int
    words: tuple[str, ...]

    @property
    def bytes(self) -> int:
        return len(self.words) * WORD_BITS // 8

    @property
    def bits(self) -> int:
        return len(self.words) * WORD_BITS

    @property
    def layout(self) -> np.dtype:
        """The record as a NumPy type of `bytes` bytes: `np.frombuffer(octets, form.layout)`.

        Fields have the words' names in lower case, with the two halves of TIME, of each force and of each
        half-width as one integer.
        """
        fields, words = [], iter(self.words)
        for word in words:
            name = word.lower()
            if word.endswith("_LOW"):
                next(words)
                fields.append((name.removesuffix("_low"), "<i8" if name.startswith("force") else "<u8"))
            else:
                fields.append((name, "<u4"))
        return np.dtype(fields)


HALF_WIDTH_WORDS = tuple(f"HALF_WIDTH_{axis}_{half}" for axis in "XYZ" for half in ("LOW", "HIGH"))
RESERVED = tuple(f"RESERVED_{k}" for k in range(10))
PLAIN = RecordForm(RECORD_FORMAT, RECORD_WORDS)
WITH_HALF_WIDTHS = RecordForm(2, (*RECORD_WORDS, *HALF_WIDTH_WORDS, *RESERVED))
"""The same words, and then of each axis half the width of the interval around its force, unsigned(64) in the
unit of its accumulator: 0 without that axis, the largest that the hardware has bits for if a soft reset came
before it was known. Reserved words are 0."""
FORMS = {form.number: form for form in (PLAIN, WITH_HALF_WIDTHS)}


def record_form(half_widths: bool) -> RecordForm:
    """The layout of the records of hardware with or without half-widths."""
    return WITH_HALF_WIDTHS if half_widths else PLAIN
