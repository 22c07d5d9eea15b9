"""cocotb bench of the calibration loader against a model of it, clock by clock; settings from its test."""

import json
import os
import random
from pathlib import Path

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import ReadOnly, RisingEdge

SET = json.loads(Path(os.environ["BENCH"]).read_text())
IMAGES, START, TABLES = SET["images"], SET["start"], SET["tables"]
IDENTIFIER, LENGTH = IMAGES[0]["words"][0], len(IMAGES[0]["words"])


class Model:
    """What the hardware must hold: `ports` are its outputs, `memory` what was written to the tables."""

    def __init__(self):
        self.words: list[int] = []
        self.loading = self.complete = False
        self.force = START
        self.memory = {name: {} for name in TABLES}

    def expects(self, word: int) -> bool:
        return bool(self.words) or word == IDENTIFIER

    def take(self, word: int) -> None:
        self.words.append(word)
        self.loading = True
        if len(self.words) == LENGTH:
            [self.force] = [image for image in IMAGES if image["words"] == self.words]
            self.words, self.complete = [], True

    def tick(self) -> None:
        """A clock after the last word the image computes."""
        if self.complete:
            self.loading = self.complete = False


class Run:
    def __init__(self, dut, seed: int):
        self.dut, self.rng, self.model = dut, random.Random(seed), Model()
        self.refused, self.known = 0, False

    @classmethod
    async def begin(cls, dut, seed: int = 1) -> "Run":
        Clock(dut.clk, 10, unit="ns").start()
        run = cls(dut, seed)
        # What a run before has left: a complete image ends it, whatever state that is.
        await run.clock(reset=1)
        await run.clock(restart=1)
        for word in IMAGES[0]["words"]:
            await run.clock(write=1, word=word)
            run.model.take(word)
        run.known = True
        await run.check()
        return run

    async def clock(self, *, write=0, word=0, idle=1, restart=0, reset=0) -> int:
        """One clock, in which the outputs are the model's; returns `taken` in it."""
        dut = self.dut
        dut.host__write.value, dut.host__word.value, dut.host__idle.value = write, word, idle
        dut.host__restart.value, dut.rst.value = restart, reset
        await ReadOnly()
        taken = int(dut.host__taken.value)
        if self.known:
            self.check_outputs()
        self.model.tick()
        for name, memory in self.model.memory.items():
            if int(getattr(dut, f"{name}__en").value):
                address = int(getattr(dut, f"{name}__addr").value)
                memory[address] = int(getattr(dut, f"{name}__data").value)
        await RisingEdge(dut.clk)
        return taken

    async def write(self, word: int, *, idle: int = 1, reset: int = 0) -> None:
        """Offer a word; the model says whether it is taken."""
        expected = int(idle and self.model.expects(word))
        taken = await self.clock(write=1, word=word, idle=idle, reset=reset)
        assert taken == expected, f"word {word:#x}: taken {taken}, expected {expected}"
        if taken:
            self.model.take(word)
        else:
            self.refused += 1

    def check_outputs(self) -> None:
        dut, model = self.dut, self.model
        assert int(dut.host__loading.value) == model.loading
        assert int(dut.host__received.value) == len(model.words)
        if model.loading:
            assert int(dut.host__bundle_hash.value) == 0
            return
        assert int(dut.host__bundle_hash.value) == int(model.force["hash"], 16)
        for name, value in model.force["registers"].items():
            assert int(getattr(dut, name).value) == int(value, 16), name

    async def check(self) -> None:
        """Registers, and everything that ever reached the tables, a clock after the last word."""
        for _ in range(2):
            await self.clock()
        assert not self.model.loading
        for name, memory in self.model.memory.items():
            expected = {k: int(value, 16) for k, value in enumerate(self.model.force["tables"][name])}
            assert memory == expected, name


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def starts_with_its_own(dut):
    """Must be the first test: what the registers hold before anything is loaded."""
    Clock(dut.clk, 10, unit="ns").start()
    run = Run(dut, 0)
    run.known = True
    await run.clock()
    await run.clock(reset=1)
    await run.clock()


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def image_after_image(dut):
    """The same registers and tables in any order of images; none is taken in part."""
    run = await Run.begin(dut)
    for image in [*IMAGES, *reversed(IMAGES)]:
        for word in image["words"]:
            await run.write(word)
        await run.check()
    assert not run.refused


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def first_word(dut):
    """Other hardware's image and words beyond the last change nothing."""
    run = await Run.begin(dut)
    for word in (IDENTIFIER ^ 1, IDENTIFIER ^ 1 << 31, IDENTIFIER ^ 0xFFFFFFFF):
        await run.write(word)
    assert run.refused == 3
    for word in [*IMAGES[1]["words"], IDENTIFIER ^ 1, IDENTIFIER ^ 2]:
        await run.write(word)
    assert run.refused == 5
    await run.check()


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def frames_under_way(dut):
    """Words are refused while they are, before an image and inside."""
    run = await Run.begin(dut)
    for word in IMAGES[1]["words"]:
        await run.write(word, idle=0)
        await run.write(word)
    await run.check()
    assert run.refused == LENGTH


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def partial_load(dut):
    """Neither a reset nor a restart ends the loading; a restart begins anew, a reset goes on."""
    run = await Run.begin(dut)
    for cut in range(1, LENGTH):
        for word in IMAGES[1]["words"][:cut]:
            await run.write(word)
        await run.clock(reset=1)
        if cut % 2:
            await run.clock(restart=1)
            run.model.words.clear()
            await run.write(IDENTIFIER ^ 1)
            cut = 0
        for word in IMAGES[1]["words"][cut:]:
            await run.write(word)
        await run.check()
        for word in IMAGES[0]["words"]:
            await run.write(word)
        await run.check()


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def reset_with_every_word(dut):
    """Each is taken, and the loading ends though the clock after the last word is one of reset, too."""
    run = await Run.begin(dut)
    for image in reversed(IMAGES):
        for word in image["words"]:
            await run.write(word, reset=1)
        await run.clock(reset=1)
        await run.check()


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def restart_without_loading(dut):
    """Nor does it harm in the clock after the last word."""
    run = await Run.begin(dut)
    await run.clock(restart=1)
    await run.check()
    for word in IMAGES[1]["words"]:
        await run.write(word)
    await run.clock(restart=1)
    await run.check()


@cocotb.test(timeout_time=5, timeout_unit="ms")
async def anything_in_any_order(dut):
    """Pauses, frames, wrong first words, resets, and restarts, all at random."""
    run = await Run.begin(dut, 3)
    rng, complete = run.rng, 0
    while complete < 30:
        words = rng.choice(IMAGES)["words"]
        while run.model.words != words[:-1] or not run.model.words:
            event = rng.random()
            if event < 0.005 and run.model.words:
                await run.clock(restart=1)
                run.model.words.clear()
                words = rng.choice(IMAGES)["words"]
            elif event < 0.01:
                await run.clock(reset=1)
            elif event < 0.1:
                await run.clock(word=rng.getrandbits(32), idle=rng.getrandbits(1))
            elif event < 0.15 and not run.model.words:
                await run.write(rng.getrandbits(32))
            else:
                await run.write(words[len(run.model.words)], idle=int(rng.random() < 0.8))
        await run.write(words[-1])
        await run.check()
        complete += 1
