"""Line buffers that turn a raster stream of displacements into the K×K patch around every pixel."""

from amaranth import Cat, Module, Mux, Shape, Signal, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.memory import Memory
from amaranth.lib.wiring import In, Out

from fastac.gateware.stream.handshake import check_lanes

KERNEL_SIZES = (1, 3, 5, 7)
"""Supported K."""


def check_patch_size(size: int, kernel_size: int, bits: int, lanes: int) -> None:
    """Raise ValueError for frame sizes, kernel sizes or lanes that `PatchGenerator` does not support."""
    check_lanes(lanes)
    if kernel_size not in KERNEL_SIZES:
        raise ValueError(f"kernel_size {kernel_size}: expected one of {KERNEL_SIZES}")
    if size < max(kernel_size, lanes + 1):
        raise ValueError(f"size {size}: expected at least {max(kernel_size, lanes + 1)}")
    if bits < 1:
        raise ValueError(f"bits {bits}: expected at least 1")


class PatchGenerator(wiring.Component):
    """The K×K neighbourhood of every pixel of N×N frames, in raster order, `lanes` patches per beat.

    Parameters: `size` N, `kernel_size` K, `bits` of a sample and whether it is `signed`, `lanes`; `fold`, the
    clocks from a beat to the next at least. A row is B = ceil(N/lanes) beats.

    Members
    -------
    i : stream of `lanes` samples, Shape(bits, signed)
    o : stream of `lanes` patches of K·K samples; sample K·a + b of lane l is the one `a − K//2` rows below
        and `b − K//2` columns right of pixel l, or 0 outside the frame. The patches of lanes beyond N in a
        row's last beat are undefined.

    A beat of patches needs samples of up to `reach` = (K//2)·B + ceil((K//2)/lanes) beats later, its
    look-ahead. So `latency` = fold · `reach` + 3 clocks (line buffer, window, border) from a beat to the
    patches of the same pixels, without back-pressure. Initiation interval: `interval` = fold · N·B clocks per
    frame, and `fold` clocks per beat: the patches that leave on their own are no faster either. The last
    `reach` beats of patches of a frame leave together with the first input beats of the next frame or, while
    none is waiting, on their own. If the next frame begins but pauses during these `reach` steps, the rest of
    the previous frame waits with it.

    There are K − 1 line buffers. They hold rows by their age in steps, not by row number, and whatever lies
    outside the frame (zeros, the previous frame, half a frame from before a reset) is replaced with 0.
    """

    def __init__(
        self, size: int, kernel_size: int, bits: int, *, lanes: int, signed: bool = False, fold: int = 1
    ):
        check_patch_size(size, kernel_size, bits, lanes)
        self.size, self.kernel_size, self.bits, self.lanes = size, kernel_size, bits, lanes
        self.fold = fold
        sample = Shape(bits, signed)
        patch = data.ArrayLayout(sample, kernel_size**2)
        super().__init__(
            {
                "i": In(stream.Signature(data.ArrayLayout(sample, lanes))),
                "o": Out(stream.Signature(data.ArrayLayout(patch, lanes))),
            }
        )

    @property
    def row_beats(self) -> int:
        return -(-self.size // self.lanes)

    @property
    def column_delay(self) -> int:
        """Beats from a beat to the one that holds the rightmost neighbours of its pixels."""
        return -(-(self.kernel_size // 2) // self.lanes)

    @staticmethod
    def reach_of(size: int, kernel_size: int, lanes: int) -> int:
        half = kernel_size // 2
        return half * -(-size // lanes) + -(-half // lanes)

    @property
    def reach(self) -> int:
        return self.reach_of(self.size, self.kernel_size, self.lanes)

    @property
    def latency(self) -> int:
        return self.fold * self.reach + 3

    @property
    def interval(self) -> int:
        return self.fold * self.size * self.row_beats

    def elaborate(self, platform):
        m = Module()
        advance = Signal()
        step = Signal()
        emit = Signal()
        stepped = Signal()  # the line buffers' read register holds a step
        valid = Signal(3)  # patches after the line buffers, in the window, at the output
        m.d.comb += [
            advance.eq(self.o.ready | ~self.o.valid),
            self.o.valid.eq(valid[-1]),
        ]
        with m.If(advance):
            m.d.sync += [stepped.eq(step), valid.eq(Cat(step & emit, valid))]

        self._schedule(m, advance, step, emit)
        columns = self._rows(m, advance, step, stepped)
        window = self._window(m, advance & stepped, columns)
        rows_inside, columns_inside = self._inside(m, advance, valid[0])

        # Replace each sample outside the frame with 0 once; the overlapping patches share the result.
        k, width = self.kernel_size, self.lanes + self.kernel_size - 1
        blanked = [
            [Signal(self.bits, reset_less=True, name=f"s_{r}_{c}") for c in range(width)] for r in range(k)
        ]
        with m.If(advance):
            m.d.sync += [
                blanked[r][c].eq(Mux(rows_inside[r] & columns_inside[c], window[r][c], 0))
                for r in range(k)
                for c in range(width)
            ]
        m.d.comb += [
            self.o.payload[lane][k * r + c].eq(blanked[r][lane + c])
            for lane in range(self.lanes)
            for r in range(k)
            for c in range(k)
        ]
        return m

    def _schedule(self, m: Module, advance, step, emit):
        """Drive `step`, the pipeline takes a beat, and `emit`, a beat of patches is complete with it.

        A step takes an input beat or, in the `reach` steps after a frame while no next frame waits, an empty
        beat. So all steps of a frame are consecutive `reach` steps after the input.
        """
        beats = self.size * self.row_beats
        index = Signal(range(beats))  # beats of the current frame already taken
        owed = Signal(
            max(1, self.reach.bit_length())
        )  # beats of patches of the previous frame that have not been emitted
        last = index == beats - 1
        may_step, ready = self.i.valid | ((index == 0) & owed.any()), advance
        if self.fold > 1:
            pause = Signal(range(self.fold))  # clocks until the next step
            with m.If(advance):
                m.d.sync += pause.eq(Mux(step, self.fold - 1, Mux(pause.any(), pause - 1, 0)))
            may_step, ready = may_step & ~pause.any(), advance & ~pause.any()
        m.d.comb += [
            self.i.ready.eq(ready),
            step.eq(may_step),
            emit.eq((index >= self.reach) | owed.any()),
        ]
        with m.If(advance & step):
            m.d.sync += owed.eq(Mux(owed.any(), owed - 1, 0))
            with m.If(self.i.valid):
                m.d.sync += index.eq(Mux(last, 0, index + 1))
                with m.If(last):
                    m.d.sync += owed.eq(self.reach)

    def _rows(self, m: Module, advance, step, stepped) -> list:
        """Line buffers: one beat of each of the last K rows at the column of the last step, oldest row first.

        One memory word holds the last K − 1 rows' beats of one column position. A step reads it and writes
        it back one clock later, shifted by one row. Read and write addresses differ, as a row has at least 2
        beats.
        """
        newest = Signal(self.lanes * self.bits, reset_less=True)
        with m.If(advance & step):
            m.d.sync += newest.eq(self.i.payload)
        if self.kernel_size == 1:
            return [newest]
        width = (self.kernel_size - 1) * len(newest)
        m.submodules.rows = rows = Memory(shape=unsigned(width), depth=self.row_beats, init=[])
        read, write = rows.read_port(), rows.write_port()
        place = Signal(range(self.row_beats))
        m.d.comb += [
            read.addr.eq(place),
            read.en.eq(advance & step),
            write.data.eq(Cat(newest, read.data)),
            write.en.eq(advance & stepped),
        ]
        with m.If(advance & step):
            m.d.sync += [
                place.eq(Mux(place == self.row_beats - 1, 0, place + 1)),
                write.addr.eq(place),
            ]
        rows_above = [read.data.word_select(k, len(newest)) for k in range(self.kernel_size - 1)]
        return [*reversed(rows_above), newest]

    def _window(self, m: Module, shift, columns: list) -> list[list]:
        """Shift registers of the samples around the pixels: K rows of columns −K//2 … lanes − 1 + K//2."""
        half, fresh = self.kernel_size // 2, self.lanes
        kept = half + (self.column_delay + 1) * fresh
        window = []
        for r, beat in enumerate(columns):
            row = [Signal(self.bits, reset_less=True, name=f"w_{r}_{c}") for c in range(kept)]
            entering = [beat.word_select(k, self.bits) for k in range(fresh)]
            with m.If(shift):
                m.d.sync += [now.eq(then) for now, then in zip(row, [*row[fresh:], *entering], strict=True)]
            window.append(row)
        return window

    def _inside(self, m: Module, advance, emitted) -> tuple[Signal, Signal]:
        """Which rows and columns of the window are inside the frame; valid one clock after `emitted`."""
        half, beats = self.kernel_size // 2, self.row_beats
        row = Signal(range(self.size))
        beat = Signal(range(beats))
        rows = Signal(self.kernel_size, reset_less=True, name="rows_inside")
        columns = Signal(self.lanes + 2 * half, reset_less=True, name="columns_inside")
        with m.If(advance & emitted):
            m.d.sync += beat.eq(Mux(beat == beats - 1, 0, beat + 1))
            with m.If(beat == beats - 1):
                m.d.sync += row.eq(Mux(row == self.size - 1, 0, row + 1))
            for r in range(self.kernel_size):
                above, below = half - r, r - half  # distance of this row of the window from the pixel's row
                m.d.sync += rows[r].eq((row >= above) if above > 0 else (row < self.size - below))
            for c in range(self.lanes + 2 * half):
                inside = [0 <= b * self.lanes + c - half < self.size for b in range(beats)]
                outside = [beat == b for b in range(beats) if not inside[b]]
                m.d.sync += columns[c].eq(~Cat(outside).any())
        return rows, columns
