# amaranth: UnusedElaboratable=no
import numpy as np
import pytest
from amaranth import Module
from amaranth.hdl import ResetInserter, Signal
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import Out
from amaranth.sim import Simulator

from fastac.gateware.poisson.tridiagonal import TridiagonalPoissonSolver
from fastac.models.integer.bounds import coefficients
from fastac.models.integer.sine_transform import SineTransform
from fastac.models.integer.source import PoissonSource
from fastac.models.integer.tridiagonal import (
    Elimination,
    Substitution,
    TridiagonalSolver,
    thomas_coefficients,
)
from fastac.models.integer.words import Fixed
from fastac.sim.check_stream import check, pack

GRADIENT_WIDTH = 10
LIMIT = 2 ** (GRADIENT_WIDTH - 1) - 1


def make(size: int, divergence: str = "central", **numbers) -> tuple[PoissonSource, TridiagonalSolver]:
    """The solver's stages for size × size inner pixels, slopes of 7 fractional bits, widths from bounds."""
    offset = np.random.default_rng(3).integers(-700, 700, (size, size))
    source = PoissonSource(divergence, GRADIENT_WIDTH, offset)
    chosen = TridiagonalSolver.fitted(
        offset=offset,
        source=Fixed(source.width, 7 + (divergence == "central")),
        slope_limit=LIMIT / 128,
        divergence=divergence,
        **{"coefficient_fraction": 17, "data_bits": 26} | numbers,
    )
    return source, chosen


def component(
    source: PoissonSource, chosen: TridiagonalSolver, lanes: int, fold: int = 1
) -> TridiagonalPoissonSolver:
    side = len(source.offset) + 2
    return TridiagonalPoissonSolver(
        source,
        chosen.row_forward,
        chosen.elimination,
        chosen.substitution,
        chosen.row_inverse,
        height=side,
        width=side,
        lanes=lanes,
        fold=fold,
        loadable=fold == 2,
    )


class WithRows(wiring.Component):
    """A solver whose output beats hold `row` too, above the solutions."""

    def __init__(self, solver: TridiagonalPoissonSolver):
        self.solver = solver
        beat = {"solutions": solver.o.payload.shape(), "row": solver.row.shape()}
        super().__init__(
            {"i": solver.signature.members["i"], "o": Out(stream.Signature(data.StructLayout(beat)))}
        )

    def elaborate(self, platform):
        m = Module()
        m.submodules.solver = solver = self.solver
        wiring.connect(m, wiring.flipped(self.i), solver.i)
        m.d.comb += [
            self.o.valid.eq(solver.o.valid),
            self.o.payload.solutions.eq(solver.o.payload),
            self.o.payload.row.eq(solver.row),
            solver.o.ready.eq(self.o.ready),
        ]
        return m


def by_beats(rows, lanes: int, void: int) -> np.ndarray:
    """Rows (rows, N) to beats (beats, lanes); `void` fills the unused lanes of each row's last beat."""
    short = -rows.shape[1] % lanes
    return np.hstack([rows, np.full((len(rows), short), void)]).reshape(-1, lanes)


@pytest.mark.parametrize(
    ("size", "lanes", "fold", "divergence", "numbers"),
    [
        (13, 1, 1, "central", {}),
        (14, 2, 1, "backward", {"data_bits": 16, "coefficient_fraction": 12}),
        (18, 4, 1, "central", {}),
        (13, 1, 1, "central", {"rounding": "floor", "data_bits": 18}),
        (6, 1, 2, "central", {}),
        pytest.param(13, 1, 4, "backward", {"rounding": "floor"}, marks=pytest.mark.full),
        pytest.param(18, 1, 8, "central", {}, marks=pytest.mark.full),
        (5, 1, 16, "central", {}),
        pytest.param(37, 1, 16, "central", {}, marks=pytest.mark.full),
    ],
)
@pytest.mark.quick("14-2-1-backward-numbers1", "6-1-2-central-numbers4")
def test_bit_exact_to_golden_model(tmp_path, size, lanes, fold, divergence, numbers):
    source, chosen = make(size, divergence, **numbers)
    dut, frames = component(source, chosen, lanes, fold), 5
    # Extremes first: zeros, the upper limit, and the signs that give the deepest solution.
    slopes = np.random.default_rng(1).integers(-LIMIT, LIMIT + 1, (frames, size + 2, size + 2, 2))
    slopes[0], slopes[1], slopes[2] = 0, LIMIT, LIMIT * np.sign(np.arange(size + 2) - size / 2)[:, None, None]
    solution = chosen(source(slopes))[:, ::-1].reshape(-1, size)
    row = np.tile(np.repeat(np.arange(size)[::-1], dut.beats), frames).tolist()
    width = chosen.depth_format.width
    frame_in, frame_out = (size + 2) ** 2 // lanes, size * dut.beats
    rows_at = lanes * width
    check(
        WithRows(dut),
        "tridiagonal_solver",
        tmp_path,
        inputs=pack(slopes.reshape(-1, lanes * 2), GRADIENT_WIDTH),
        expected=[
            word | at << rows_at
            for word, at in zip(pack(by_beats(solution, lanes, 0), width), row, strict=True)
        ],
        mask=[mask | -1 << rows_at for mask in pack(by_beats(np.full_like(solution, -1), lanes, 0), width)],
        latencies=[
            (0, 0, dut.latency),
            (0, frame_out - 1, dut.frame_latency),
            # Frames overlap: no input beat waits, and a solution leaves every `interval` clocks.
            (0, frames * frame_out - 1, dut.frame_latency + (frames - 1) * dut.interval),
            ((frames - 1) * frame_in, frames * frame_out - 1, dut.frame_latency),
        ],
        # Long pauses are for the small ones: here they would take longer than all the rest.
        stalls=(0, 0.3, 0.9) if size < 30 else (0, 0.3),
    )


@pytest.mark.parametrize("fold", [1, 2])
@pytest.mark.quick("2")
def test_reset_within_a_frame_starts_afresh_and_rows_carry_their_address(fold):
    size = 5
    source, chosen = make(size)
    dut = component(source, chosen, lanes=1, fold=fold)
    reset = Signal()
    slopes = np.random.default_rng(2).integers(-LIMIT, LIMIT + 1, (size + 2, size + 2, 2))
    words = pack(slopes.reshape(-1, 2), GRADIENT_WIDTH)
    expected = [
        (row, z) for row, line in reversed([*enumerate(chosen(source(slopes)).tolist())]) for z in line
    ]

    async def bench(ctx):
        ctx.set(dut.o.ready, 1)
        for length in range(1, 3 * len(words), 6 * fold):
            await feed(ctx, length)
            ctx.set(reset, 1)
            await ctx.tick()
            ctx.set(reset, 0)
            assert await feed(ctx, len(words), dut.frame_latency) == expected

    async def feed(ctx, beats: int, clocks: int = 0) -> list[tuple[int, int]]:
        received = []
        for n in range(beats * fold + clocks):
            ctx.set(dut.i.valid, n < beats * fold)
            ctx.set(dut.i.payload.as_value(), words[n // fold % len(words)])
            *_, valid, row, value = await ctx.tick().sample(dut.o.valid, dut.row, dut.o.payload[0])
            if valid:
                received.append((row, value))
        return received

    simulator = Simulator(ResetInserter(reset)(dut))
    simulator.add_clock(1e-8)
    simulator.add_testbench(bench)
    simulator.run()


@pytest.mark.parametrize(
    ("lanes", "fold", "frame_latency", "interval", "multipliers"),
    [
        (1, 1, 32_427, 16_384, 128),
        (2, 1, 16_234, 8_192, 256),
        (4, 1, 8_202, 4_096, 512),
        (1, 16, 518_202, 262_144, 10),
    ],
)
@pytest.mark.quick("4-1-8202-4096-512", "1-16-518202-262144-10")
def test_cost_of_the_paper_s_frame(lanes, fold, frame_latency, interval, multipliers):
    source, matrix = PoissonSource("central", 17, np.zeros((126, 126), int)), coefficients(126, 17)
    c = thomas_coefficients(126, 17)
    parts = (
        SineTransform(matrix, 14, source.width, 26),
        Elimination(c, 17, 26, 26),
        Substitution(c, 17, 26, 26, 5),
        SineTransform(matrix, 14, 26, 26),
    )
    dut = TridiagonalPoissonSolver(source, *parts, height=128, width=128, lanes=lanes, fold=fold)
    assert (dut.frame_latency, dut.interval, dut.multipliers) == (frame_latency, interval, multipliers)
    # By hand: the source's last beat and its buffer; rows in and out (5 clocks and 6 levels of 63 products
    # and a half unit, or folded 6 clocks, 4 products and 16 steps); both recurrences; the reversal, from the
    # last row back to the first; one more buffer.
    row, transform = fold * (dut.beats - 1), 11 if fold == 1 else 6 + 4 + fold
    source = fold * (127 * (128 // lanes) + (2 if lanes == 1 else 1)) + row + 5 + 1
    reversal = 3 + fold * 125 * dut.beats
    assert dut.frame_latency == source + 2 * (transform + row) + 6 + reversal + (6 + 1)


def test_invalid_arguments():
    source, chosen = make(14)
    parts = (source, chosen.row_forward, chosen.elimination, chosen.substitution, chosen.row_inverse)
    with pytest.raises(ValueError, match="height 20: expected width = 16"):
        TridiagonalPoissonSolver(*parts, height=20, width=16, lanes=1)
    with pytest.raises(ValueError, match="row_forward of size 14: expected width - 2 = 16"):
        TridiagonalPoissonSolver(*parts, height=18, width=18, lanes=1)
    with pytest.raises(ValueError, match="fold 2: expected 1 with lanes = 2"):
        TridiagonalPoissonSolver(*parts, height=16, width=16, lanes=2, fold=2)
    with pytest.raises(ValueError, match="fold 3: expected one of"):
        TridiagonalPoissonSolver(*parts, height=16, width=16, lanes=1, fold=3)
    with pytest.raises(ValueError, match="rows of 14 values, 4 beats: expected at least 5 beats"):
        TridiagonalPoissonSolver(*parts, height=16, width=16, lanes=4)
    narrow = make(14, data_bits=14)[1]
    with pytest.raises(ValueError, match=r"substitution\.input_width 14: expected 1[5-9]"):
        TridiagonalPoissonSolver(
            *parts[:3], narrow.substitution, narrow.row_inverse, height=16, width=16, lanes=1
        )
