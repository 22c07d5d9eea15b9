# amaranth: UnusedElaboratable=no
import numpy as np
import pytest
from amaranth.hdl import Fragment, ResetInserter, Signal
from amaranth.sim import Simulator

from fastac.gateware.fz_stream import PatchForceStream, PixelResponse, kernel_words
from fastac.models.integer.force import PatchForce
from fastac.sim.amaranth_simulator import run_streams
from fastac.sim.check_stream import check, pack


def beats(frames, lanes, rng):
    """Frames (F, N, N) to beats (F·N·ceil(N/lanes), lanes); unused lanes are random."""
    fill = rng.integers(0, 1 << 16, (*frames.shape[:2], -frames.shape[2] % lanes))
    return np.concatenate([frames, fill], axis=-1).reshape(-1, lanes)


def inside(n, k):
    """Mask (N, N, K, K) of the neighbours of each pixel that are inside the frame."""
    near = np.arange(n)[:, None] + np.arange(k) - k // 2
    near = (near >= 0) & (near < n)
    return near[:, None, :, None] & near[None, :, None, :]


def extreme_force(n, k, kernel_bits, bits, axes, rng, signed=False):
    """Axis 0 has random kernels; axis 1 the lowest and axis 2 the highest word, inside the frame only."""
    limit = 1 << (kernel_bits - 1)
    kernel = rng.integers(-limit, limit, (axes, n, n, k, k))
    for axis, word in list(enumerate((-limit, limit - 1), start=1))[: axes - 1]:
        kernel[axis] = word * inside(n, k)
    return PatchForce(kernel, kernel_bits, bits, signed)


def frames_of(force, rng):
    """Frames of full scale, zeros, one corner each, random values; two with the signs of axis 0's weights."""
    n, top = force.kernel.shape[1], force.displacement_limit
    low = -top if force.signed else 0
    q = rng.integers(low, top + 1, (9, n, n))
    q[0], q[1:6] = top, 0
    for frame, corner in enumerate([(0, 0), (0, -1), (-1, 0), (-1, -1)], start=2):
        q[(frame, *corner)] = top
    units = np.eye(n * n, dtype=np.int64).reshape(-1, n, n)
    q[6] = np.where((force(units)[:, 0] > 0).reshape(n, n), top, low)
    q[7] = top + low - q[6]
    return q


@pytest.mark.parametrize(
    ("n", "k", "kernel_bits", "bits", "lanes", "axes", "signed"),
    [
        (8, 7, 8, 8, 1, 2, False),
        (9, 5, 8, 8, 4, 2, True),
        (9, 3, 6, 8, 2, 3, False),
        (11, 1, 8, 7, 4, 1, True),
        (6, 3, 18, 16, 1, 3, False),
    ],
)
@pytest.mark.quick("9-3-6-8-2-3-False", mutate=["9-5-8-8-4-2-True"])
def test_force_of_every_frame(tmp_path, n, k, kernel_bits, bits, lanes, axes, signed):
    rng = np.random.default_rng(1)
    force = extreme_force(n, k, kernel_bits, bits, axes, rng, signed)
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


def map_beats(force, q, lanes):
    """The responses of frames (F, N, N) as payloads of the map; unused lanes are zero."""
    responses = np.pad(force.force_map(q), [(0, 0)] * 3 + [(0, -q.shape[-1] % lanes)])
    frames, axes, n, columns = responses.shape
    lined_up = responses.reshape(frames, axes, n, columns // lanes, lanes)
    return pack(lined_up.transpose(0, 2, 3, 1, 4).reshape(-1, axes, lanes), force.pixel_width)


@pytest.mark.parametrize("n", [7, 8])
@pytest.mark.parametrize("k", [1, 3, 5, 7])
@pytest.mark.parametrize("lanes", [1, 2, 4])
@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.quick(
    "False-2-3-8",
    "True-1-5-8",
    "True-4-1-8",
    "False-4-7-7",
    mutate=["False-1-1-7", "True-2-7-7", "False-4-5-7", "True-1-3-7"],
)
def test_force_and_map_of_every_frame(n, k, lanes, signed):
    """Without pauses, with pauses on all streams, and with back-pressure from the map alone."""
    axes = 3 if k == 1 else 2 if k == 3 else 1
    rng = np.random.default_rng(k)
    force = extreme_force(n, k, 4, 5, axes, rng, signed)
    q = frames_of(force, rng)
    inputs = pack(beats(q, lanes, rng), 5)
    expected = {"o": pack(force(q), force.width), "map": map_beats(force, q, lanes)}
    counts = {name: len(payloads) for name, payloads in expected.items()}
    for stalls in (0, {"i": 0.3, "o": 0.8, "map": 0.3}, {"i": 0, "o": 0, "map": 0.7}):
        dut = PatchForceStream(force, lanes=lanes, wants_map=True)
        payloads, taken = run_streams(dut, inputs, counts, stall=stalls)
        assert payloads == expected
        if stalls == 0:
            waits = [t - s for s, t in zip(taken["i"], taken["map"], strict=True)]
            assert waits == [dut.map_latency] * len(waits)
            last = taken["i"][dut.interval - 1 :: dut.interval]
            assert [t - s for s, t in zip(last, taken["o"], strict=True)] == [dut.latency] * len(q)


def test_extremes_reach_the_bounds_of_signed_responses():
    """Every displacement is at its limit, with the sign of its weight."""
    rng = np.random.default_rng(6)
    n = 6
    kernel = rng.integers(-7, 8, (1, n, n, 3, 3)) * inside(n, 3)
    kernel[..., 1, 1] = 0
    kernel[0, 2, 3] = [[-8, 7, -8], [7, -8, 7], [-8, 7, -8]]
    force = PatchForce(kernel, 4, 6, signed=True)
    q = np.zeros((2, n, n), int)
    q[0, 1:4, 2:5] = 31 * np.sign(kernel[0, 2, 3])
    q[1] = -q[0]
    assert force.force_map(q)[:, 0, 2, 3].tolist() == [force.pixel_bound, -force.pixel_bound]
    dut = PatchForceStream(force, lanes=2, wants_map=True)
    payloads, _ = run_streams(dut, pack(beats(q, 2, rng), 6), {"map": 36, "o": 2})
    assert payloads["map"] == map_beats(force, q, 2)
    assert payloads["o"] == pack(force(q), force.width)


def test_force_map_is_built_only_if_wanted():
    force = extreme_force(6, 3, 4, 5, 1, np.random.default_rng(7))

    def parts(**options):
        dut = PatchForceStream(force, lanes=2, **options)
        return hasattr(dut, "map"), {name for _, name, _ in Fragment.get(dut, None).subfragments}

    assert parts() == (False, {"generator", "response", "accumulator"})
    assert parts(wants_map=True) == (True, {"generator", "response", "accumulator", "map_fork"})


def run(force, lanes, actions, forces, ready=lambda clock: True, clocks=4000):
    """Drive `actions` (a payload, None for a pause, or "reset") under Amaranth's simulator.

    Returns the forces, the clock of each force, and the clock of each accepted input beat.
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
    """The latency is the same after every pause, from none to longer than the flush of the last patches."""
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
    """A frame pauses after its first beats, at every stage of the previous frame's flush."""
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


def test_back_pressure_stalls_without_loss(small):
    force, q, payloads = small
    actions = [a for frame in payloads for a in frame]
    values, taken, sent = run(force, 2, actions, len(q), ready=lambda clock: clock >= 300)
    assert values == force(q).tolist()
    waiting = [s for s in sent if s < taken[0]]
    dut = PatchForceStream(force, lanes=2)
    assert len(waiting) <= dut.interval + dut.latency


def test_paper_scale_latency_and_interval():
    """A frame of 128×128 pixels at one per clock takes 16,384 clocks, which the force must not exceed."""
    force = PatchForce(np.ones((1, 126, 126, 5, 5), dtype=np.int64), 8, 8)
    for lanes, latency, interval in ((1, 268, 15_876), (2, 142, 7_938), (4, 81, 4_032)):
        dut = PatchForceStream(force, lanes=lanes)
        assert (dut.latency, dut.interval) == (latency, interval)
        assert dut.interval + dut.latency <= 16_384
        assert dut.multipliers == 25 * lanes
    wide = PatchForce(force.kernel, 20, 17)
    assert PatchForceStream(wide, lanes=1).multipliers == 25
    wide = PatchForce(force.kernel, 20, 18)
    assert PatchForceStream(wide, lanes=1).multipliers == 50, (
        "19 bits with the sign times 20 bits need two DSP slices"
    )


def test_width_and_latency_of_the_responses():
    force = extreme_force(8, 5, 8, 8, 3, np.random.default_rng(5))
    dut = PixelResponse(force, lanes=2)
    Fragment.get(dut, None)
    assert dut.o.payload.shape().size == 3 * 2 * force.pixel_width
    assert dut.latency == 5 + 5


def test_responses_from_the_first_clock_after_a_reset(tmp_path):
    """The first patch waits for the first kernels; the others do not wait."""
    rng = np.random.default_rng(8)
    force = extreme_force(5, 3, 4, 5, 2, rng)
    dut = PixelResponse(force, lanes=1)
    patches = rng.integers(0, 32, (60, 1, 9))
    kernels = kernel_words(force, 1)[np.arange(60) % 25]
    check(
        dut,
        "pixel_response",
        tmp_path,
        inputs=pack(patches, 5),
        expected=pack((patches[:, None] * kernels).sum(axis=-1), force.pixel_width),
        latencies=[(k, k, dut.latency) for k in range(60)] + [(0, 59, 59 + dut.latency)],
    )


def test_invalid_arguments():
    kernel = np.zeros((1, 8, 8, 3, 3), dtype=np.int64)
    with pytest.raises(ValueError, match=r"kernel \(1, 8, 7, 3, 3\): expected \(axes, N, N, K, K\)"):
        PatchForceStream(PatchForce(kernel[:, :, :7], 8, 8), lanes=1)
    with pytest.raises(ValueError, match="lanes 8: expected one of"):
        PatchForceStream(PatchForce(kernel, 8, 8), lanes=8)
    with pytest.raises(ValueError, match="kernel_size 9: expected one of"):
        PatchForceStream(PatchForce(np.zeros((1, 9, 9, 9, 9), dtype=np.int64), 8, 8), lanes=1)
