"""Model of the writing half (S2MM) of AMD's AXI VDMA, for streams of video.

Rules are those of the product guide PG020, AXI VDMA v6.3, web edition of 2022-06-08, named by the page's
title:

1. "Fsync Options", s2mm tuser: the start of a frame is bit 0 of s_axis_s2mm_tuser, one valid transfer wide,
at the
   frame's first pixel. There is no room for other bits: a stream with a wider tuser is refused.
2. "Line and Frame Errors", table of the write path: a line that ends before HSIZE bytes is EOLEarlyErr, one
that goes
   on behind them EOLLateErr; a start of frame before VSIZE lines is SOFEarlyErr; lines behind VSIZE are
   dropped and set SOFLateErr. The channel goes on.
3. "AXI VDMA Register Address Map" and "Line and Frame Errors": S2MM_VDMASR is at 34h, with SOFEarlyErr in bit
7,
   EOLEarlyErr in 8, SOFLateErr in 11 and EOLLateErr in 15; VSIZE at A0h, HSIZE at A4h.
4. UG934 (AXI4-Stream Video IP and System Design Guide, web edition of 2022-11-16), "Incorrect Timing
Information":
   after a short line data go on at the start of the next one; of a long line the surplus is dropped up to its
   end.

Assumptions: errors stay until they are cleared by writing 1; frames are written one behind the other; tdata
must have a width of rule 9 of `axi_dma`.
"""

from fastac.sim.dma.axi_dma import WIDTHS, DmaMisuse, Memory

SOF_EARLY, EOL_EARLY, SOF_LATE, EOL_LATE = 1 << 7, 1 << 8, 1 << 11, 1 << 15
"""Bits of S2MM_VDMASR."""
STATUS, VSIZE, HSIZE = 0x34, 0xA0, 0xA4


class AxiVdma:
    """Takes beats of video at `base` and behind it; `frames` counts those that came whole.

    bits, user_bits : widths of tdata and tuser
    """

    def __init__(self, memory: Memory, *, bits: int, user_bits: int, base: int = 0):
        if bits not in WIDTHS:
            raise DmaMisuse(f"tdata of {bits} bits: expected one of {WIDTHS}")
        if user_bits != 1:
            raise DmaMisuse(f"tuser of {user_bits} bits: expected 1, the start of frame")
        self.memory, self.octets, self.base = memory, bits // 8, base
        self.height = self.line_bytes = self.status = self.frames = 0
        self._line = self._column = 0
        self._inside = self._overlong = False

    def read(self, offset: int) -> int:
        return {STATUS: self.status, VSIZE: self.height, HSIZE: self.line_bytes}[offset]

    def write(self, offset: int, value: int) -> None:
        if offset == STATUS:
            self.status &= ~value
        elif offset == HSIZE:
            self.line_bytes = value
        elif offset == VSIZE:  # starts the channel, written last
            self.height = value

    def beat(self, octets: bytes, *, last: bool, start: bool) -> None:
        """A beat is transferred."""
        if start:
            if self._inside and self._line < self.height:
                self.status |= SOF_EARLY
            self._inside, self._overlong, self._line, self._column = True, False, 0, 0
        if not self._inside:
            return
        if self._line >= self.height:
            self.status |= SOF_LATE
            return
        if self._overlong:
            self._overlong = not last
            return
        frame = self.base + self.frames * self.height * self.line_bytes
        self.memory.write(frame + self._line * self.line_bytes + self._column, octets)
        self._column += self.octets
        whole = self._column >= self.line_bytes
        if last and not whole:
            self.status |= EOL_EARLY
        if whole and not last:
            self.status |= EOL_LATE
            self._overlong = True
        if last or whole:
            self._line, self._column = self._line + 1, 0
            if self._line == self.height and not self.status & (SOF_EARLY | EOL_EARLY | EOL_LATE):
                self.frames += 1
