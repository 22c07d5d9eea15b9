"""cocotb bench of the whole hardware whose calibration changes while it runs.

The frames `own` are as the bundle in the hardware makes them, `other` the same images as another one does,
whose image is `words`. Every test ends with the bundle's own calibration, with which the next one begins.
See tests/gateware/test_top_calibration.py.
"""

import sys

import cocotb
from cocotb.triggers import ClockCycles

from fastac.sim.benches.host import OKAY, SLVERR, write
from fastac.sim.benches.top import ADDRESS, LINGER, SET
from fastac.sim.benches.top_run import ENABLE, FRAME_BEATS, INTERRUPT, STALLS, TEST, Run, beats, flags

RESTART, LOADING = 16, 8
OWN, OTHER = SET["own"], SET["other"]
IMAGES = {name: SET["words"][name] for name in ("own", "other")}
HASH = SET["hash"]
REFUSED = flags("calibration_refused")


async def offer(run: Run, word: int, size: int = 4) -> int:
    return await write(run.host.master, ADDRESS["CALIBRATION"], word, size)


async def load(run: Run, name: str, start: int = 0, end: int | None = None) -> None:
    """Words of an image; from the first to the last one the hardware says that it is loading."""
    words = IMAGES[name]
    for k, word in list(enumerate(words, 1))[start:end]:
        assert await offer(run, word) == OKAY, f"word {k} of {len(words)} refused"
        if k in (1, len(words) // 2, len(words) - 1):
            await run.expect(CALIBRATION_RECEIVED=k, BUNDLE_HASH_LOW=0, BUNDLE_HASH_HIGH=0)
            assert await run.host.read("STATUS") & LOADING
    if end is None:
        await run.expect(
            CALIBRATION_RECEIVED=0,
            BUNDLE_HASH_LOW=HASH[name] & 0xFFFFFFFF,
            BUNDLE_HASH_HIGH=HASH[name] >> 32,
        )
        assert not await run.host.read("STATUS") & LOADING


async def send(run: Run, frames: list[int]) -> None:
    """Frames, and everything that they give."""
    run.mark()
    run.streams.beats += beats(*frames)
    await run.finish(frames)


async def no_error(run: Run) -> None:
    assert not await run.host.read("ERRORS") & REFUSED


@cocotb.test(**TEST)
@cocotb.parametrize(stall=STALLS)
async def between_frames(dut, stall):
    """And back again. Frames that come while words are loaded wait, and lose nothing."""
    run = await Run.begin(dut, stall)
    await run.expect(CALIBRATION_WORDS=len(IMAGES["own"]), CALIBRATION_LAYOUT=IMAGES["own"][0])
    await send(run, OWN)
    half = len(IMAGES["own"]) // 2
    for name, frames in (("other", OTHER), ("own", OWN)):
        run.mark()
        await load(run, name, 0, half)
        run.streams.beats += beats(*frames)
        before = len(run.streams.taken_at)
        await ClockCycles(dut.clk, 2 * FRAME_BEATS)
        assert len(run.streams.taken_at) == before + 1, "a frame did not wait with its first beat"
        await load(run, name, half)
        await run.finish(frames)
    await no_error(run)


@cocotb.test(**TEST)
@cocotb.parametrize(stall=STALLS, closed=[False, True])
async def under_way(dut, stall, closed):
    """Words are refused from a frame's first beat to its last result, and change nothing."""
    run = await Run.begin(dut, stall)
    run.streams.beats += beats(*OWN[:2])
    await run.taken(FRAME_BEATS // 2)
    run.streams.closed = closed
    for word in IMAGES["other"][:5]:
        assert await offer(run, word) == SLVERR
    await run.expect(CALIBRATION_RECEIVED=0, BUNDLE_HASH_LOW=HASH["own"] & 0xFFFFFFFF)
    run.streams.limit = sys.maxsize
    if closed and run.streams.sinks:
        await ClockCycles(dut.clk, 4 * FRAME_BEATS)
    while await run.host.read("STATUS") & 1:
        refused = await offer(run, IMAGES["other"][0])
        if refused == OKAY:  # the last result left between the two accesses
            break
        run.streams.closed = False
    else:
        assert await offer(run, IMAGES["other"][0]) == OKAY
    await load(run, "other", 1)
    await run.finish(OWN[:2])
    assert await run.host.read("ERRORS") & REFUSED
    await run.host.write("ERRORS", REFUSED)
    await no_error(run)
    await send(run, OTHER[:2])
    await load(run, "own")
    await send(run, OWN[:2])
    await no_error(run)


@cocotb.test(**TEST)
async def other_hardwares_image(dut):
    """Refused with its first word, and the frames after it are as before; so are partial writes."""
    run = await Run.begin(dut)
    await send(run, OWN[:1])
    first = IMAGES["own"][0]
    for word, size in ((first ^ 1, 4), (first ^ 1 << 31, 4), (first & 0xFFFFFF, 3)):
        assert await offer(run, word, size) == SLVERR
    await run.expect(CALIBRATION_RECEIVED=0)
    assert not await run.host.read("STATUS") & LOADING
    await send(run, OWN[1:])
    assert await run.host.read("ERRORS") & REFUSED


@cocotb.test(**TEST)
@cocotb.parametrize(reset=["soft", "hard"])
async def half_loaded(dut, reset):
    """A reset leaves it half loaded, and nothing computes; a restart begins the image anew."""
    run = await Run.begin(dut)
    half = len(IMAGES["other"]) // 2
    await load(run, "other", 0, half)
    await (run.soft_reset if reset == "soft" else run.hard_reset)()
    await run.expect(CALIBRATION_RECEIVED=half, BUNDLE_HASH_LOW=0, BUNDLE_HASH_HIGH=0)
    run.mark()
    run.streams.beats += beats(*OTHER)
    before = len(run.streams.taken_at)
    await run.host.write("CONTROL", ENABLE | INTERRUPT | RESTART)
    await run.expect(CALIBRATION_RECEIVED=0, CONTROL=ENABLE | INTERRUPT)
    assert await run.host.read("STATUS") & LOADING
    assert await offer(run, IMAGES["other"][half]) == SLVERR
    await ClockCycles(dut.clk, LINGER)
    assert len(run.streams.taken_at) == before + 1, "a frame did not wait with its first beat"
    await load(run, "other")
    await run.finish(OTHER)
    # It outlives both resets.
    for again in (run.soft_reset, run.hard_reset):
        await again()
        await send(run, OTHER[:1])
    await load(run, "own")
    await send(run, OWN[:1])


@cocotb.test(**TEST)
async def a_first_word_as_a_frame_starts(dut):
    """Whichever comes first: a frame is of one calibration alone, and none is lost."""
    run = await Run.begin(dut)
    answers = []
    for delay in range(-6, 7):
        run.mark()
        if delay < 0:
            run.streams.beats += beats(0)
            await ClockCycles(dut.clk, -delay)
        writing = cocotb.start_soon(offer(run, IMAGES["other"][0]))
        if delay >= 0:
            await ClockCycles(dut.clk, 1 + delay)
            run.streams.beats += beats(0)
        answers.append(await writing)
        if answers[-1] == OKAY:
            await load(run, "other", 1)
            await run.finish(OTHER[:1])
            await load(run, "own")
        else:
            await run.finish(OWN[:1])
    assert set(answers) == {OKAY, SLVERR}, f"answers {answers}"
