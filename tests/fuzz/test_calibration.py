# amaranth: UnusedElaboratable=no
"""Damaged calibration images, written word by word into the hardware's loader, in Amaranth's simulator."""

import struct
from functools import cache
from pathlib import Path

import fuzzing
import numpy as np
import pytest
from amaranth.sim import Simulator
from fuzzing import Reader
from mutations import changed_bytes

from fastac.gateware.bus.calibration_loader import CalibrationLoader, ImageLayout
from fastac.gateware.stream.tables import TableFormat

LAYOUT = ImageLayout(
    0x89ABCDEF,
    {"rest": TableFormat(depth=3, fields=1, bits=32), "offset": TableFormat(depth=2, fields=2, bits=11)},
    {"network": 45, "constant": 30},
)
START = {"network": 1, "constant": 2}, 0x0123456789ABCDEF
WHOLE = {"network": 2**45 - 2, "constant": 12345}, 0xFEDCBA9876543210
TABLES = {"rest": np.array([[-(2**31)], [7], [2**31 - 1]]), "offset": np.array([[-1024, 1023], [5, -6]])}
IMAGE = LAYOUT.image(TABLES, *WHOLE).astype("<u4").tobytes()
IDENTIFIER = struct.pack("<I", LAYOUT.identifier)


class ImageError(ValueError):
    """An image that the hardware does not use."""


class Loader:
    """The loader in a simulation that begins anew for each image."""

    def __init__(self):
        self.dut = CalibrationLoader(LAYOUT, *START)
        self.words: list[int] | None = None
        self.simulator = Simulator(self.dut)
        self.simulator.add_clock(1e-6)
        self.simulator.add_testbench(self._write)

    def run(self, words: list[int]) -> None:
        """Write `words`, then restart and write the whole image; what is seen is in `after` and `at_end`."""
        if self.words is not None:  # a reset before the first run would drop a coroutine that never began
            self.simulator.reset()
        self.words = words
        self.simulator.run()

    async def _write(self, ctx) -> None:
        host = self.dut.host
        self.tables = {name: {} for name in LAYOUT.tables}
        self.taken = []
        ctx.set(host.idle, 1)
        await self._words(ctx, self.words)
        self.after = self._state(ctx)
        ctx.set(host.restart, 1)
        await ctx.tick()
        ctx.set(host.restart, 0)
        await self._words(ctx, list(struct.unpack(f"<{len(IMAGE) // 4}I", IMAGE)))
        self.at_end = self._state(ctx)

    async def _words(self, ctx, words: list[int]) -> None:
        """A word each clock, and three clocks more; what is written to the tables is kept."""
        for word in (*words, None, None, None):
            ctx.set(self.dut.host.write, word is not None)
            ctx.set(self.dut.host.word, word or 0)
            if word is not None:
                self.taken.append(ctx.get(self.dut.host.taken))
            await ctx.tick()
            for name, table in LAYOUT.tables.items():
                port = getattr(self.dut, name)
                if ctx.get(port.en):
                    address = ctx.get(port.addr)
                    assert address < table.depth, f"{name}: address {address}"
                    self.tables[name][address] = ctx.get(port.data)

    def _state(self, ctx) -> dict:
        registers = {name: ctx.get(getattr(self.dut, name)) for name in LAYOUT.registers}
        host = self.dut.host
        return {
            "loading": ctx.get(host.loading),
            "received": ctx.get(host.received),
            "hash": ctx.get(host.bundle_hash),
            "registers": registers,
            "tables": {name: dict(table) for name, table in self.tables.items()},
        }


@cache
def loader() -> Loader:
    return Loader()


def packed(values: np.ndarray, bits: int) -> dict[int, int]:
    return {
        at: sum((int(value) & (1 << bits) - 1) << bits * k for k, value in enumerate(row))
        for at, row in enumerate(values)
    }


def expected(words: list[int]) -> tuple[list[bool], int, list[int] | None]:
    """By the images' rules: which words are taken, how many of an incomplete image, the last complete one."""
    taken, image, complete = [], [], None
    for word in words:
        taken.append(bool(image) or word == LAYOUT.identifier)
        if taken[-1]:
            image.append(word)
        if len(image) == LAYOUT.words:
            complete, image = image, []
    return taken, len(image), complete


def load(folder: Path) -> None:
    """Write an image as a driver does; raises ImageError where it is not what the hardware then uses."""
    path = folder / "calibration.bin"
    content = path.read_bytes()
    words = list(struct.unpack(f"<{len(content) // 4}I", content[: len(content) // 4 * 4]))
    simulated = loader()
    simulated.run(words)
    taken, received, complete = expected(words)
    after, at_end = simulated.after, simulated.at_end
    assert simulated.taken[: len(words)] == taken
    assert after["received"] == received
    assert after["loading"] == bool(received)
    registers, known_hash = START
    if complete is not None:
        chain = int.from_bytes(
            struct.pack(f"<{LAYOUT.chain_words}I", *complete[-LAYOUT.chain_words :]), "little"
        )
        registers = {"network": chain % 2**45, "constant": (chain >> 45) % 2**30}
        known_hash = chain >> 32 * LAYOUT.chain_words - 64
    if received:
        assert after["hash"] == 0
    else:
        assert (after["registers"], after["hash"]) == (registers, known_hash)
    assert (at_end["registers"], at_end["hash"], at_end["loading"]) == (*WHOLE, 0)
    assert at_end["tables"] == {n: packed(TABLES[n], table.bits) for n, table in LAYOUT.tables.items()}
    if received or complete is None:
        raise ImageError(f"{path}: {received} of {LAYOUT.words} words: no calibration is in use")


IMAGES = changed_bytes(
    [IMAGE, IMAGE + IMAGE], (IDENTIFIER, IMAGE, IMAGE[:20], IMAGE[4:], b"\x00" * 4, b"\xff" * 40, b"\x00")
)
READERS = [Reader("calibration image", IMAGES.map(lambda content: {"calibration.bin": content}), load)]


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_bad_files(reader, tmp_path):
    fuzzing.quick(reader, tmp_path)


def test_the_whole_image_is_used(tmp_path):
    (tmp_path / "calibration.bin").write_bytes(IMAGE)
    load(tmp_path)
    (tmp_path / "calibration.bin").write_bytes(IMAGE[:-4])
    with pytest.raises(ImageError, match="12 of 13 words"):
        load(tmp_path)
