# amaranth: UnusedElaboratable=no
import numpy as np
import pytest
from amaranth.hdl import Fragment, ResetInserter, Signal
from amaranth.sim import Simulator

from gateware.fz_stream import PatchForceStream, PixelResponse
from models.integer import PatchForce
from sim.stream import check, pack


def beats(frames, lanes, rng):
    """Frames (F, N, N) to beats (F·N·ceil(N/lanes), lanes); void lanes are random."""
    fill = rng.integers(0, 1 << 16, (*frames.shape[:2], -frames.shape[2] % lanes))
    return np.concatenate([frames, fill], axis=-1).reshape(-1, lanes)


def inside(n, k):
    """Which neighbours of which pixels are inside the frame: (N, N, K, K)."""
    near = np.arange(n)[:, None] + np.arange(k) - k // 2
    near = (near >= 0) & (near < n)
    return near[:, None, :, None] & near[None, :, None, :]


def extreme_force(n, k, kernel_bits, bits, axes, rng):
    """Axis 0: any kernel words; axis 1 the lowest, axis 2 the highest, both only inside the frame."""
    limit = 1 << (kernel_bits - 1)
    kernel = rng.integers(-limit, limit, (axes, n, n, k, k))
    for axis, word in list(enumerate((-limit, limit - 1), start=1))[: axes - 1]:
        kernel[axis] = word * inside(n, k)
    return PatchForce(kernel, kernel_bits, bits)


def frames_of(force, rng):
    """Full scale, zero, each corner alone, then random; two by the signs of axis 0's weights."""
    n, top = force.kernel.shape[1], (1 << force.displacement_bits) - 1
    q = rng.integers(0, top + 1, (9, n, n))
    q[0], q[1:6] = top, 0
    for frame, corner in enumerate([(0, 0), (0, -1), (-1, 0), (-1, -1)], start=2):
        q[(frame, *corner)] = top
    units = np.eye(n * n, dtype=np.int64).reshape(-1, n, n)
    q[6] = top * (force(units)[:, 0] > 0).reshape(n, n)
    q[7] = top - q[6]
    return q


@pytest.mark.parametrize(
    ("n", "k", "kernel_bits", "bits", "lanes", "axes"),
    [(8, 7, 8, 8, 1, 2), (9, 5, 8, 8, 4, 2), (9, 3, 6, 8, 2, 3), (11, 1, 8, 7, 4, 1)],
)
def test_force_of_every_frame(tmp_path, n, k, kernel_bits, bits, lanes, axes):
    rng = np.random.default_rng(1)
    force = extreme_force(n, k, kernel_bits, bits, axes, rng)
    q = frames_of(force, rng)
    expected = force(q)
    if axes > 1:
        assert expected[0, 1] == -force.bound, "the bound is reached exactly"
    dut = PatchForceStream(force, lanes=lanes)
    per_row = -(-n // lanes)
    assert dut.interval == n * per_row
    last = [(f + 1) * dut.interval - 1 for f in range(len(q))]
    check(
        dut,
        "fz_stream",
        tmp_path,
        inputs=pack(beats(q, lanes, rng), bits),
        expected=pack(expected, force.width),
        mask=(1 << axes * force.width) - 1,
        latencies=[(b, f, dut.latency) for f, b in enumerate(last)]
        + [(0, f, dut.latency + b) for f, b in enumerate(last)],
    )


def run(force, lanes, actions, forces, ready=lambda clock: True, clocks=4000):
    """Feed `actions` (a payload, or None: a pause, or "reset") to Amaranth's simulator.

    Returns the forces and, for each, the clock in which it was taken, and those in which beats were.
    """
    dut, reset = PatchForceStream(force, lanes=lanes), Signal()
    sent, taken, values = [], [], []

    async def source(ctx):
        clock = 0
        for action in actions:
            ctx.set(reset, action == "reset")
            ctx.set(dut.i.valid, isinstance(action, int))
            if isinstance(action, int):
                ctx.set(dut.i.payload.as_value(), action)
            while True:
                *_, moved = await ctx.tick().sample(dut.i.ready)
                clock += 1
                if moved or not isinstance(action, int):
                    break
            if isinstance(action, int):
                sent.append(clock - 1)
        ctx.set(dut.i.valid, 0)

    async def sink(ctx):
        for clock in range(clocks):
            ctx.set(dut.o.ready, ready(clock))
            *_, left, valid, payload = await ctx.tick().sample(dut.o.ready, dut.o.valid, dut.o.payload)
            if left and valid:
                values.append([payload[axis] for axis in range(len(force.kernel))])
                taken.append(clock)
            if len(values) == forces and clock > taken[-1] + 200:
                break

    simulator = Simulator(ResetInserter(reset)(dut))
    simulator.add_clock(1e-6)
    simulator.add_testbench(source)
    simulator.add_testbench(sink)
    simulator.run()
    return values, taken, sent


@pytest.fixture
def small():
    rng = np.random.default_rng(4)
    force = extreme_force(5, 3, 8, 8, 3, rng)
    q = rng.integers(0, 256, (12, 5, 5))
    payloads = [pack(beats(frame[None], 2, rng), 8) for frame in q]
    return force, q, payloads


def test_next_frame_may_begin_at_any_time(small):
    """After every pause from none to longer than the flush, the latency is the same."""
    force, q, payloads = small
    actions = [a for pause, frame in enumerate(payloads) for a in [*frame, *[None] * pause]]
    values, taken, sent = run(force, 2, actions, len(q))
    dut = PatchForceStream(force, lanes=2)
    assert len(q) > 4, "the longest pause outlasts the flush: one row of 3 beats, and one beat"
    assert values == force(q).tolist()
    assert [t - s for t, s in zip(taken, sent[dut.interval - 1 :: dut.interval], strict=True)] == [
        dut.latency
    ] * len(q)


def test_next_frame_may_pause_before_the_previous_force(small):
    """However many of its beats have come, and however much of the flush before them is done."""
    force, q, payloads = small
    for begun in (1, 2, 3, 5):
        actions = []
        for pause, frame in enumerate(payloads):
            actions += [*frame[:begun], *[None] * 9, *frame[begun:], *[None] * (pause % 6)]
        values, *_ = run(force, 2, actions, len(q))
        assert values == force(q).tolist()


def test_reset_in_the_middle_of_a_frame(small):
    force, q, payloads = small
    dut = PatchForceStream(force, lanes=2)
    for beats_before in (1, 7, dut.interval - 1):
        for flushed in (0, 3):
            broken = [*payloads[0], *[None] * flushed, *payloads[1][:beats_before], "reset"]
            values, *_ = run(force, 2, [*broken, *payloads[2], *payloads[3]], 2 + (beats_before > 10))
            assert values[-2:] == force(q[2:4]).tolist()


def test_an_untaken_force_stops_everything_and_loses_nothing(small):
    force, q, payloads = small
    actions = [a for frame in payloads for a in frame]
    values, taken, sent = run(force, 2, actions, len(q), ready=lambda clock: clock >= 300)
    assert values == force(q).tolist()
    waiting = [s for s in sent if s < taken[0]]
    dut = PatchForceStream(force, lanes=2)
    assert len(waiting) <= dut.interval + dut.latency


def test_paper_scale_latency_and_interval():
    """The whole frame's budget at one pixel a clock is 16,384 clocks (128×128 pixels)."""
    force = PatchForce(np.ones((1, 126, 126, 5, 5), dtype=np.int64), 8, 8)
    for lanes, latency, interval in ((1, 266, 15_876), (2, 140, 7_938), (4, 79, 4_032)):
        dut = PatchForceStream(force, lanes=lanes)
        assert (dut.latency, dut.interval) == (latency, interval)
        assert dut.interval + dut.latency <= 16_384


def test_response_is_as_wide_as_stated():
    force = extreme_force(8, 5, 8, 8, 3, np.random.default_rng(5))
    dut = PixelResponse(force, lanes=2)
    Fragment.get(dut, None)
    assert dut.o.payload.shape().size == 3 * 2 * force.pixel_width
    assert dut.latency == 3 + 5


def test_refusals():
    kernel = np.zeros((1, 8, 8, 3, 3), dtype=np.int64)
    with pytest.raises(ValueError, match=r"kernel \(1, 8, 7, 3, 3\): expected \(axes, N, N, K, K\)"):
        PatchForceStream(PatchForce(kernel[:, :, :7], 8, 8), lanes=1)
    with pytest.raises(ValueError, match="lanes 8: expected one of"):
        PatchForceStream(PatchForce(kernel, 8, 8), lanes=8)
    with pytest.raises(ValueError, match="kernel_size 9: expected one of"):
        PatchForceStream(PatchForce(np.zeros((1, 9, 9, 9, 9), dtype=np.int64), 8, 8), lanes=1)
