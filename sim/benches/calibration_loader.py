"""cocotb testbench of CalibrationLoader, compared with a model in every clock.

Settings are in the file BENCH; tests/gateware/bus/test_calibration_loader.py makes them.
"""

import json
import os
import random
from pathlib import Path

import cocotb
from cocotb.clock import Clock
from cocotb.triggers import ReadOnly, RisingEdge

SETTINGS = json.loads(Path(os.environ["BENCH"]).read_text())
IMAGES, START, FIELDS = SETTINGS["images"], SETTINGS["start"], SETTINGS["fields"]
IDENTIFIER, LENGTH = IMAGES[0]["words"][0], len(IMAGES[0]["words"])


class Model:
    """Model: `words` received of an incomplete image, the `active` image, and the tables' `memory`."""

    def __init__(self):
        self.words: list[int] = []
        self.loading = self.complete = False
        self.active = START
        self.due: dict[str, int] = {}  # tables that are written in this clock, at which address
        self.memory = {name: {} for name in FIELDS}

    def accepts(self, word: int) -> bool:
        """Whether `word` may be the next word of an image."""
        return bool(self.words) or word == IDENTIFIER

    def accept(self, word: int, *, restart: int = 0) -> None:
        self.words.append(word)
        place = len(self.words) - 2  # after the identifier
        for name, fields in FIELDS.items():
            address, field = divmod(place, fields)
            if 0 <= address < len(START["tables"][name]) and field == fields - 1:
                self.due[name] = address
            place -= fields * len(START["tables"][name])
        if restart:
            self.words.clear()
            return
        self.loading = True
        if len(self.words) == LENGTH:
            [self.active] = [image for image in IMAGES if image["words"] == self.words]
            self.words, self.complete = [], True

    def tick(self) -> None:
        """End of a clock: one clock after its last word, a complete image becomes active."""
        self.due.clear()
        if self.complete:
            self.loading = self.complete = False


class Testbench:
    """Driver of the loader's host bus, and scoreboard of all of its outputs."""

    def __init__(self, dut, seed: int):
        self.dut, self.rng, self.model = dut, random.Random(seed), Model()
        self.refused, self.model_valid = 0, False

    @classmethod
    async def start(cls, dut, seed: int = 1) -> "Testbench":
        Clock(dut.clk, 10, unit="ns").start()
        bench = cls(dut, seed)
        # A complete image ends whatever state the previous test left.
        await bench.cycle(reset=1)
        await bench.cycle(restart=1)
        for word in IMAGES[0]["words"]:
            await bench.cycle(write=1, word=word)
            bench.model.accept(word)
        bench.model_valid = True
        await bench.check_all()
        return bench

    async def cycle(self, *, write=0, word=0, idle=1, restart=0, reset=0) -> int:
        """Drive one clock, compare the outputs with the model, and return `taken`."""
        dut = self.dut
        dut.host__write.value, dut.host__word.value, dut.host__idle.value = write, word, idle
        dut.host__restart.value, dut.rst.value = restart, reset
        await ReadOnly()
        taken = int(dut.host__taken.value)
        if self.model_valid:
            self.check_outputs()
        for name, memory in self.model.memory.items():
            if int(getattr(dut, f"{name}__en").value):
                address = int(getattr(dut, f"{name}__addr").value)
                memory[address] = int(getattr(dut, f"{name}__data").value)
        self.model.tick()
        await RisingEdge(dut.clk)
        return taken

    async def write(self, word: int, *, idle: int = 1, reset: int = 0, restart: int = 0) -> None:
        """Write a word and check that it is accepted or refused as in the model."""
        expected = int(idle and self.model.accepts(word))
        taken = await self.cycle(write=1, word=word, idle=idle, reset=reset, restart=restart)
        assert taken == expected, f"word {word:#x}: taken {taken}, expected {expected}"
        if taken:
            self.model.accept(word, restart=restart)
        else:
            self.refused += 1

    def check_outputs(self) -> None:
        """Compare the outputs with the model."""
        dut, model = self.dut, self.model
        assert int(dut.host__loading.value) == model.loading
        assert int(dut.host__received.value) == len(model.words)
        for name in FIELDS:
            written = int(getattr(dut, f"{name}__en").value)
            assert written == (name in model.due), name
            assert not written or int(getattr(dut, f"{name}__addr").value) == model.due[name], name
        if model.loading:
            assert int(dut.host__bundle_hash.value) == 0
            return
        assert int(dut.host__bundle_hash.value) == int(model.active["hash"], 16)
        for name, value in model.active["registers"].items():
            assert int(getattr(dut, name).value) == int(value, 16), name

    async def check_all(self) -> None:
        """Compare registers and the content of all tables after an image."""
        for _ in range(2):
            await self.cycle()
        assert not self.model.loading
        for name, memory in self.model.memory.items():
            expected = {k: int(value, 16) for k, value in enumerate(self.model.active["tables"][name])}
            assert memory == expected, name


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def initial_registers(dut):
    """The registers' initial values; must be the first test, before anything is loaded."""
    Clock(dut.clk, 10, unit="ns").start()
    bench = Testbench(dut, 0)
    bench.model_valid = True
    await bench.cycle()
    await bench.cycle(reset=1)
    await bench.cycle()


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def successive_images(dut):
    """Images in any order give their own registers and tables, and each becomes active as a whole."""
    bench = await Testbench.start(dut)
    for image in [*IMAGES, *reversed(IMAGES)]:
        for word in image["words"]:
            await bench.write(word)
        await bench.check_all()
    assert not bench.refused


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def wrong_first_words(dut):
    """Another hardware's identifier, and words after the last word of an image, are refused."""
    bench = await Testbench.start(dut)
    for word in (IDENTIFIER ^ 1, IDENTIFIER ^ 1 << 31, IDENTIFIER ^ 0xFFFFFFFF):
        await bench.write(word)
    assert bench.refused == 3
    for word in [*IMAGES[1]["words"], IDENTIFIER ^ 1, IDENTIFIER ^ 2]:
        await bench.write(word)
    assert bench.refused == 5
    await bench.check_all()


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def words_refused_while_not_idle(dut):
    """Words are refused while frames are in flight, before an image and inside one."""
    bench = await Testbench.start(dut)
    for word in IMAGES[1]["words"]:
        await bench.write(word, idle=0)
        await bench.write(word)
    await bench.check_all()
    assert bench.refused == LENGTH


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def reset_or_restart_inside_an_image(dut):
    """Neither ends `loading`; after a reset the image goes on, after a restart it begins again."""
    bench = await Testbench.start(dut)
    for cut in range(1, LENGTH):
        for word in IMAGES[1]["words"][:cut]:
            await bench.write(word)
        await bench.cycle(reset=1)
        if cut % 2:
            await bench.cycle(restart=1)
            bench.model.words.clear()
            await bench.write(IDENTIFIER ^ 1)
            cut = 0
        for word in IMAGES[1]["words"][cut:]:
            await bench.write(word)
        await bench.check_all()
        for word in IMAGES[0]["words"]:
            await bench.write(word)
        await bench.check_all()


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def reset_with_every_word(dut):
    """Words are accepted during reset, and an image becomes active even if reset follows its last word."""
    bench = await Testbench.start(dut)
    for image in reversed(IMAGES):
        for word in image["words"]:
            await bench.write(word, reset=1)
        await bench.cycle(reset=1)
        await bench.check_all()


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def restart_without_loading(dut):
    """A restart has no effect between images, even in the clock after the last word."""
    bench = await Testbench.start(dut)
    await bench.cycle(restart=1)
    await bench.check_all()
    for word in IMAGES[1]["words"]:
        await bench.write(word)
    await bench.cycle(restart=1)
    await bench.check_all()


@cocotb.test(timeout_time=1, timeout_unit="ms")
async def restart_in_the_clock_of_a_word(dut):
    """The word is discarded too: not even a last word ends `loading` then."""
    bench = await Testbench.start(dut)
    for count in range(LENGTH):
        for word in IMAGES[1]["words"][:count]:
            await bench.write(word)
        await bench.write(IMAGES[1]["words"][count], restart=1)
        for _ in range(2):
            await bench.cycle()
        for word in IMAGES[2]["words"]:
            await bench.write(word)
        await bench.check_all()


@cocotb.test(timeout_time=5, timeout_unit="ms")
async def random_events(dut):
    """Random pauses, frames, wrong first words, resets and restarts."""
    bench = await Testbench.start(dut, 3)
    rng, complete = bench.rng, 0
    while complete < 30:
        words = rng.choice(IMAGES)["words"]
        while bench.model.words != words[:-1] or not bench.model.words:
            event = rng.random()
            if event < 0.005 and bench.model.words:
                await bench.cycle(restart=1)
                bench.model.words.clear()
                words = rng.choice(IMAGES)["words"]
            elif event < 0.01:
                await bench.cycle(reset=1)
            elif event < 0.1:
                await bench.cycle(word=rng.getrandbits(32), idle=rng.getrandbits(1))
            elif event < 0.15 and not bench.model.words:
                await bench.write(rng.getrandbits(32))
            else:
                await bench.write(words[len(bench.model.words)], idle=int(rng.random() < 0.8))
        await bench.write(words[-1])
        await bench.check_all()
        complete += 1
