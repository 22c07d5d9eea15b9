"""cocotb testbench of the top level: loading calibrations between frames.

There are two bundles. The frames `own` carry the golden outputs of the bundle that the hardware was built
from, the frames `other` those of a second bundle for the same images; `words` holds both calibration images.
Every test ends with the hardware's own calibration, with which the next one begins.
tests/gateware/test_top_calibration.py makes the settings.
"""

import sys

import cocotb
from cocotb.triggers import ClockCycles

from fastac.sim.benches.host import OKAY, SLVERR, write
from fastac.sim.benches.top import ADDRESS, LINGER, SETTINGS
from fastac.sim.benches.top_testbench import (
    ENABLE,
    FRAME_BEATS,
    INTERRUPT,
    STALLS,
    TEST,
    Testbench,
    error_bits,
    frame_beats_of,
)

RESTART, LOADING = 16, 8
OWN, OTHER = SETTINGS["own"], SETTINGS["other"]
IMAGES = {name: SETTINGS["words"][name] for name in ("own", "other")}
HASH = SETTINGS["hash"]
REFUSED = error_bits("calibration_refused")


async def offer(bench: Testbench, word: int, size: int = 4) -> int:
    return await write(bench.host.master, ADDRESS["CALIBRATION"], word, size)


async def load(bench: Testbench, name: str, start: int = 0, end: int | None = None) -> None:
    """Write an image's words `start` to `end`; check the registers that report the progress."""
    words = IMAGES[name]
    for k, word in list(enumerate(words, 1))[start:end]:
        assert await offer(bench, word) == OKAY, f"word {k} of {len(words)} refused"
        if k in (1, len(words) // 2, len(words) - 1):
            await bench.expect_registers(CALIBRATION_RECEIVED=k, BUNDLE_HASH_LOW=0, BUNDLE_HASH_HIGH=0)
            assert await bench.host.read("STATUS") & LOADING
    if end is None:
        await bench.expect_registers(
            CALIBRATION_RECEIVED=0,
            BUNDLE_HASH_LOW=HASH[name] & 0xFFFFFFFF,
            BUNDLE_HASH_HIGH=HASH[name] >> 32,
        )
        assert not await bench.host.read("STATUS") & LOADING


async def send(bench: Testbench, frames: list[int]) -> None:
    """Send frames and compare all of their outputs."""
    bench.compare_from_here()
    bench.streams.beats += frame_beats_of(*frames)
    await bench.expect_frames(frames)


async def no_error(bench: Testbench) -> None:
    assert not await bench.host.read("ERRORS") & REFUSED


@cocotb.test(**TEST)
@cocotb.parametrize(stall=STALLS)
async def calibration_between_frames(dut, stall):
    """Load the other calibration and the own one again; frames that come meanwhile wait and are complete."""
    bench = await Testbench.start(dut, stall)
    await bench.expect_registers(CALIBRATION_WORDS=len(IMAGES["own"]), CALIBRATION_LAYOUT=IMAGES["own"][0])
    await send(bench, OWN)
    half = len(IMAGES["own"]) // 2
    for name, frames in (("other", OTHER), ("own", OWN)):
        bench.compare_from_here()
        await load(bench, name, 0, half)
        bench.streams.beats += frame_beats_of(*frames)
        before = len(bench.streams.accepted_at)
        await ClockCycles(dut.clk, 2 * FRAME_BEATS)
        assert len(bench.streams.accepted_at) == before + 1, "a frame did not wait with its first beat"
        await load(bench, name, half)
        await bench.expect_frames(frames)
    await no_error(bench)


@cocotb.test(**TEST)
@cocotb.parametrize(stall=STALLS, blocked=[False, True])
async def words_refused_while_frames_are_in_flight(dut, stall, blocked):
    """From a frame's first beat to its last result, words are refused and change nothing."""
    bench = await Testbench.start(dut, stall)
    bench.streams.beats += frame_beats_of(*OWN[:2])
    await bench.send_only(FRAME_BEATS // 2)
    bench.streams.blocked = blocked
    for word in IMAGES["other"][:5]:
        assert await offer(bench, word) == SLVERR
    await bench.expect_registers(CALIBRATION_RECEIVED=0, BUNDLE_HASH_LOW=HASH["own"] & 0xFFFFFFFF)
    bench.streams.limit = sys.maxsize
    if blocked and bench.streams.sinks:
        # Beats that do not leave wait in queues, and none of the next calibration's may join them.
        for _ in range(4):
            await ClockCycles(dut.clk, FRAME_BEATS)
            assert await offer(bench, IMAGES["other"][0]) == SLVERR
    while await bench.host.read("STATUS") & 1:
        refused = await offer(bench, IMAGES["other"][0])
        if refused == OKAY:  # the last result left between the two accesses
            break
        bench.streams.blocked = False
    else:
        assert await offer(bench, IMAGES["other"][0]) == OKAY
    await load(bench, "other", 1)
    await bench.expect_frames(OWN[:2])
    assert await bench.host.read("ERRORS") & REFUSED
    await bench.host.write("ERRORS", REFUSED)
    await no_error(bench)
    await send(bench, OTHER[:2])
    await load(bench, "own")
    await send(bench, OWN[:2])
    await no_error(bench)


@cocotb.test(**TEST)
async def image_of_other_hardware(dut):
    """Another hardware's image is refused at its first word, as are partial writes; frames are unchanged."""
    bench = await Testbench.start(dut)
    await send(bench, OWN[:1])
    first = IMAGES["own"][0]
    for word, size in ((first ^ 1, 4), (first ^ 1 << 31, 4), (first & 0xFFFFFF, 3)):
        assert await offer(bench, word, size) == SLVERR
    await bench.expect_registers(CALIBRATION_RECEIVED=0)
    assert not await bench.host.read("STATUS") & LOADING
    await send(bench, OWN[1:])
    assert await bench.host.read("ERRORS") & REFUSED


@cocotb.test(**TEST)
@cocotb.parametrize(reset=["soft", "hard"])
async def reset_inside_an_image(dut, reset):
    """A reset keeps a half loaded image, and no frame starts; `restart_calibration` discards it."""
    bench = await Testbench.start(dut)
    half = len(IMAGES["other"]) // 2
    await load(bench, "other", 0, half)
    await (bench.soft_reset if reset == "soft" else bench.hard_reset)()
    await bench.expect_registers(CALIBRATION_RECEIVED=half, BUNDLE_HASH_LOW=0, BUNDLE_HASH_HIGH=0)
    bench.compare_from_here()
    bench.streams.beats += frame_beats_of(*OTHER)
    before = len(bench.streams.accepted_at)
    await bench.host.write("CONTROL", ENABLE | INTERRUPT | RESTART)
    await bench.expect_registers(CALIBRATION_RECEIVED=0, CONTROL=ENABLE | INTERRUPT)
    assert await bench.host.read("STATUS") & LOADING
    assert await offer(bench, IMAGES["other"][half]) == SLVERR
    await ClockCycles(dut.clk, LINGER)
    assert len(bench.streams.accepted_at) == before + 1, "a frame did not wait with its first beat"
    await load(bench, "other")
    await bench.expect_frames(OTHER)
    # Both kinds of reset keep a loaded calibration.
    for again in (bench.soft_reset, bench.hard_reset):
        await again()
        await send(bench, OTHER[:1])
    await load(bench, "own")
    await send(bench, OWN[:1])


@cocotb.test(**TEST)
async def first_word_while_a_frame_starts(dut):
    """Whichever comes first, each frame uses one calibration only, and no frame is lost."""
    bench = await Testbench.start(dut)
    answers = []
    for delay in range(-6, 7):
        bench.compare_from_here()
        if delay < 0:
            bench.streams.beats += frame_beats_of(0)
            await ClockCycles(dut.clk, -delay)
        writing = cocotb.start_soon(offer(bench, IMAGES["other"][0]))
        if delay >= 0:
            await ClockCycles(dut.clk, 1 + delay)
            bench.streams.beats += frame_beats_of(0)
        answers.append(await writing)
        if answers[-1] == OKAY:
            await load(bench, "other", 1)
            await bench.expect_frames(OTHER[:1])
            await load(bench, "own")
        else:
            await bench.expect_frames(OWN[:1])
    assert set(answers) == {OKAY, SLVERR}, f"answers {answers}"
