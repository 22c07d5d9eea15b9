# amaranth: UnusedElaboratable=no
from dataclasses import replace

import numpy as np
import pytest
from amaranth.hdl import ResetInserter, Signal
from amaranth.sim import Simulator

from fastac.gateware.poisson.dst2d import PoissonSolver
from fastac.models.integer.dst2d import EigenvalueDivision
from fastac.models.integer.sine_transform import SineTransform
from fastac.models.integer.source import PoissonSource
from fastac.models.integer.words import signed_width
from fastac.sim.check_stream import check, pack


def stages(size: int, *, gradient_width: int = 10, divergence: str = "central") -> tuple:
    """The solver's integer stages for size × size inner pixels, widths from bounds."""
    offset = np.random.default_rng(3).integers(-700, 700, (size, size))
    source = PoissonSource(divergence, gradient_width, offset)
    k = np.arange(1, size + 1)
    sine = np.sin(np.pi / (size + 1) * (np.outer(k, k) % (2 * size + 2)))
    matrix = np.round(2.0**16 * np.sqrt(2 / (size + 1)) * sine).astype(np.int64)

    def transform(input_width: int) -> SineTransform:
        bound = (int(np.abs(matrix).sum(axis=1).max()) << (input_width - 1)) + (1 << 15)
        return SineTransform(matrix, 16, input_width, signed_width(bound >> 16))

    row_forward = transform(source.width)
    column_forward = transform(row_forward.output_width)
    cosine = 2 * np.cos(np.pi * k / (size + 1))
    reciprocal = 1 / (4 - (cosine[:, None] + cosine))
    shift = 16 - np.floor(np.log2(reciprocal)).astype(np.int64)
    mantissa = np.minimum(np.round(reciprocal * 2.0**shift), (1 << 17) - 1).astype(np.int64)
    width = column_forward.output_width
    bound = int(((mantissa << (width - 1)) >> shift).max()) + 1
    division = EigenvalueDivision(mantissa, shift, width, signed_width(bound))
    column_inverse = transform(division.output_width)
    return (
        source,
        row_forward,
        column_forward,
        division,
        column_inverse,
        transform(column_inverse.output_width),
    )


def solve(chain: tuple, slopes: np.ndarray) -> np.ndarray:
    """Slopes (..., H, W, 2) to solutions (..., N, N), by the golden model."""
    source, row_forward, column_forward, division, column_inverse, row_inverse = chain
    columns = np.swapaxes(row_forward(source(slopes)), -1, -2)
    columns = column_inverse(division(column_forward(columns)))
    return row_inverse(np.swapaxes(columns, -1, -2))


def by_beats(rows, lanes: int, void: int) -> np.ndarray:
    """Rows (rows, N) to beats (beats, lanes); `void` fills the unused lanes of each row's last beat."""
    short = -rows.shape[1] % lanes
    return np.hstack([rows, np.full((len(rows), short), void)]).reshape(-1, lanes)


@pytest.mark.parametrize(
    ("size", "lanes", "fold", "divergence"),
    [
        (13, 1, 1, "central"),
        (14, 2, 1, "backward"),
        (14, 4, 1, "central"),
        (6, 1, 2, "central"),
        pytest.param(13, 1, 4, "backward", marks=pytest.mark.full),
        pytest.param(18, 1, 8, "central", marks=pytest.mark.full),
        (5, 1, 16, "central"),
        pytest.param(36, 1, 16, "central", marks=pytest.mark.full),
    ],
)
@pytest.mark.quick("14-2-1-backward", "5-1-16-central")
def test_bit_exact_to_golden_model(tmp_path, size, lanes, fold, divergence):
    chain, frames = stages(size, divergence=divergence), 5
    dut = PoissonSolver(*chain, height=size + 2, width=size + 2, lanes=lanes, fold=fold)
    # Extremes first: zeros, the upper limit, and the signs that give the deepest solution.
    slopes = np.random.default_rng(1).integers(-511, 512, (frames, size + 2, size + 2, 2))
    slopes[0], slopes[1], slopes[2] = 0, 511, 511 * np.sign(np.arange(size + 2) - size / 2)[:, None, None]
    solution = solve(chain, slopes).reshape(-1, size)
    width = chain[-1].output_width
    frame_in, frame_out = (size + 2) ** 2 // lanes, size * dut.beats
    check(
        dut,
        "poisson_solver",
        tmp_path,
        inputs=pack(slopes.reshape(-1, lanes * 2), 10),
        expected=pack(by_beats(solution, lanes, 0), width),
        mask=pack(by_beats(np.full_like(solution, -1), lanes, 0), width),
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
@pytest.mark.quick("1")
def test_reset_within_a_frame_starts_afresh(fold):
    size = 5
    chain = stages(size)
    dut = PoissonSolver(*chain, height=size + 2, width=size + 2, lanes=1, fold=fold)
    reset = Signal()
    slopes = np.random.default_rng(2).integers(-511, 512, (size + 2, size + 2, 2))
    words, solution = pack(slopes.reshape(-1, 2), 10), solve(chain, slopes).ravel().tolist()

    async def bench(ctx):
        ctx.set(dut.o.ready, 1)
        for length in range(1, 3 * len(words), 6 * fold):
            await feed(ctx, length)
            ctx.set(reset, 1)
            await ctx.tick()
            ctx.set(reset, 0)
            received = await feed(ctx, len(words), dut.frame_latency)
            assert received == solution

    async def feed(ctx, beats: int, clocks: int = 0) -> list[int]:
        received = []
        for n in range(beats * fold + clocks):
            ctx.set(dut.i.valid, n < beats * fold)
            ctx.set(dut.i.payload.as_value(), words[n // fold % len(words)])
            *_, valid, value = await ctx.tick().sample(dut.o.valid, dut.o.payload[0])
            if valid:
                received.append(value)
        return received

    simulator = Simulator(ResetInserter(reset)(dut))
    simulator.add_clock(1e-8)
    simulator.add_testbench(bench)
    simulator.run()


@pytest.mark.parametrize(
    ("lanes", "fold", "frame_latency", "interval", "multipliers"),
    [
        (1, 1, 48_698, 16_384, 253),
        (2, 1, 24_378, 8_192, 506),
        (4, 1, 12_347, 4_096, 1_012),
        (1, 16, 778_253, 262_144, 17),
    ],
)
@pytest.mark.quick("1-1-48698-16384-253", "1-16-778253-262144-17")
def test_cost_of_the_paper_s_frame(lanes, fold, frame_latency, interval, multipliers):
    source, *parts = stages(126)
    # Words as long as a scene may have them; those of the hand-made stages are longer.
    words = [{k: min(getattr(p, k), 26) for k in ("input_width", "output_width")} for p in parts]
    parts = [replace(part, **widths) for part, widths in zip(parts, words, strict=True)]
    dut = PoissonSolver(source, *parts, height=128, width=128, lanes=lanes, fold=fold)
    assert (dut.frame_latency, dut.interval, dut.multipliers) == (frame_latency, interval, multipliers)


def test_invalid_arguments():
    chain = stages(14)
    with pytest.raises(ValueError, match="height 20: expected width = 16"):
        PoissonSolver(*chain, height=20, width=16, lanes=1)
    with pytest.raises(ValueError, match="row_forward of size 14: expected width - 2 = 16"):
        PoissonSolver(*chain, height=18, width=18, lanes=1)
    with pytest.raises(ValueError, match=r"column_forward\.input_width 14: expected 15"):
        PoissonSolver(
            chain[0], chain[1], stages(14, gradient_width=9)[2], *chain[3:], height=16, width=16, lanes=1
        )
