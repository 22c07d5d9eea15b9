"""Loader of a calibration image: the host's 32-bit words go to the datapath's registers and tables."""

from dataclasses import dataclass

import numpy as np
from amaranth import Cat, Const, Module, Mux, Signal, unsigned
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.stream.tables import TableFormat

WORD = 32
"""Bits of one word of an image."""
HASH = 64
"""Bits of a bundle's hash."""


def calibration_signature() -> wiring.Signature:
    """Bus between the register block and the loader, seen from the register block.

    write, word : the host writes the next word of an image
    taken : the loader accepts that word, in the same clock
    idle : no frame is in flight; no frame may start in a clock with `write`
    restart : discard the words received; the next word is the first of an image
    loading : high from the first accepted word until the image is complete; no frame may start meanwhile
    received : number of words received of an incomplete image; 0 if there is none
    bundle_hash : hash of the active calibration's bundle; 0 while `loading`
    """
    return wiring.Signature(
        {
            "write": Out(1),
            "word": Out(unsigned(WORD)),
            "taken": In(1),
            "idle": Out(1),
            "restart": Out(1),
            "loading": In(1),
            "received": In(unsigned(32)),
            "bundle_hash": In(unsigned(HASH)),
        }
    )


@dataclass(frozen=True)
class ImageLayout:
    """Layout of a calibration image, a sequence of 32-bit words.

    Word 0 is `identifier`, by which the hardware recognises an image made for it. Then come the tables'
    values in order, one per word, sign-extended. Then come the registers, packed from the least significant
    bit on into whole words, and in the last two words the 64-bit hash of the bundle.
    """

    identifier: int
    tables: dict[str, TableFormat]
    registers: dict[str, int]
    """Bits of each register."""

    def __post_init__(self):
        if not 0 <= self.identifier < 1 << WORD:
            raise ValueError(f"identifier {self.identifier}: expected {WORD} bits")
        if not self.registers or min(self.registers.values()) < 1:
            raise ValueError(f"registers {self.registers}: expected at least one, of at least one bit each")
        for name, table in self.tables.items():
            if not 1 <= table.bits <= WORD:
                raise ValueError(f"{name} of {table.bits} bits: expected 1 to {WORD}, a word of the image")
            if table.depth < 2 or table.fields < 1 or table.fields & (table.fields - 1):
                raise ValueError(
                    f"{name} of {table.depth} words of {table.fields}: expected 2 or more of a power of two"
                )

    @property
    def chain_words(self) -> int:
        """Words of the packed registers and the hash, which the hardware keeps in one shift register."""
        return -(-sum(self.registers.values()) // WORD) + HASH // WORD

    @property
    def sections(self) -> list[int]:
        """Number of words of each section, in order: identifier, each table, registers with hash."""
        return [1, *(table.depth * table.fields for table in self.tables.values()), self.chain_words]

    @property
    def words(self) -> int:
        """Number of words of an image."""
        return sum(self.sections)

    def chain(self, registers: dict[str, int], bundle_hash: int) -> int:
        """The registers' values and the hash, packed into one integer as in the image's last words."""
        chain, low = 0, 0
        for name, bits in self.registers.items():
            if not 0 <= registers[name] < 1 << bits:
                raise ValueError(f"{name} {registers[name]:#x}: expected {bits} bits")
            chain |= registers[name] << low
            low += bits
        return chain | bundle_hash << (WORD * self.chain_words - HASH)

    def image(self, tables: dict[str, np.ndarray], registers: dict[str, int], bundle_hash: int) -> np.ndarray:
        """The image, uint32 (words,), from the tables' values (depth, fields) and the registers' values."""
        parts = [np.array([self.identifier], np.uint32)]
        for name, table in self.tables.items():
            values, limit = np.asarray(tables[name], np.int64), 1 << (table.bits - 1)
            if values.shape != (table.depth, table.fields):
                raise ValueError(f"{name} {values.shape}: expected {(table.depth, table.fields)}")
            if values.min() < -limit or values.max() >= limit:
                raise ValueError(f"{name} {values.min()} to {values.max()}: expected {-limit} to {limit - 1}")
            parts.append((values.ravel() & 0xFFFFFFFF).astype(np.uint32))
        chain = self.chain(registers, bundle_hash).to_bytes(WORD // 8 * self.chain_words, "little")
        return np.concatenate([*parts, np.frombuffer(chain, "<u4").astype(np.uint32)])


class CalibrationLoader(wiring.Component):
    """Load calibration images of `layout` word by word while no frame is in flight.

    Parameters: `registers` and `bundle_hash`, the values after configuration of the device.

    Members
    -------
    host : see `calibration_signature`. A word is refused, without effect, while not `idle`, and if a first
        word is not the layout's identifier.
    one output per register of the layout, unsigned of its bits; it changes only while `host.loading`
    one write port per table of the layout, see `TableFormat.signature`

    An incomplete calibration is never used: `host.loading` stays high, and keeps frames out, until an image
    is complete. A reset changes neither what was loaded nor how much of an image has been received. Registers
    and hash are one shift register that shifts by 32 bits one clock after each word; `host.loading` falls
    after the last shift. A table's word is written one clock after the last of its values.
    """

    def __init__(self, layout: ImageLayout, registers: dict[str, int], bundle_hash: int):
        self.layout = layout
        self.initial = layout.chain(registers, bundle_hash)
        super().__init__(
            {
                "host": In(calibration_signature()),
                **{name: Out(unsigned(bits)) for name, bits in layout.registers.items()},
                **{name: Out(table.signature) for name, table in layout.tables.items()},
            }
        )

    def elaborate(self, platform):
        m = Module()
        host = self.host
        sections = self.layout.sections
        loading = Signal(reset_less=True)
        received = Signal(range(self.layout.words), reset_less=True)
        section = Signal(range(len(sections)), reset_less=True)
        place = Signal(range(max(sections)), reset_less=True)  # word within the section
        last = Signal()
        m.d.comb += [
            host.taken.eq(
                host.write & host.idle & ((section != 0) | (host.word == Const(self.layout.identifier, WORD)))
            ),
            host.loading.eq(loading),
            host.received.eq(received),
        ]
        with m.Switch(section):
            for k, length in enumerate(sections):
                with m.Case(k):
                    m.d.comb += last.eq(place == length - 1)
        # The shift register's enable has a fan-out of thousands, so it is registered.
        complete = Signal()
        shifts = Signal(reset_less=True)
        finished = Signal(reset_less=True)
        word = Signal(WORD, reset_less=True)
        in_chain = section == len(sections) - 1
        m.d.comb += complete.eq(last & in_chain)
        m.d.sync += [
            word.eq(host.word),
            shifts.eq(host.taken & in_chain),
            finished.eq(host.taken & complete & ~host.restart),
        ]
        with m.If(finished):
            m.d.sync += loading.eq(0)
        with m.If(host.restart):
            m.d.sync += [received.eq(0), section.eq(0), place.eq(0)]
        with m.Elif(host.taken):
            with m.If(~complete):
                m.d.sync += loading.eq(1)
            m.d.sync += [
                received.eq(Mux(complete, 0, received + 1)),
                place.eq(Mux(last, 0, place + 1)),
            ]
            with m.If(last):
                m.d.sync += section.eq(Mux(complete, 0, section + 1))

        chain = Signal(WORD * self.layout.chain_words, init=self.initial, reset_less=True)
        with m.If(shifts):
            m.d.sync += chain.eq(Cat(chain, word)[WORD:])
        m.d.comb += host.bundle_hash.eq(Mux(loading, 0, chain[-HASH:]))
        low = 0
        for name, bits in self.layout.registers.items():
            m.d.comb += getattr(self, name).eq(chain[low : low + bits])
            low += bits

        # The values received last, the newest in the most significant bits.
        fields = max((table.fields for table in self.layout.tables.values()), default=0)
        values = Signal(WORD * fields, reset_less=True)
        if fields:
            with m.If(host.taken):
                m.d.sync += values.eq(Cat(values, host.word)[WORD:])
        for k, (name, table) in enumerate(self.layout.tables.items(), start=1):
            port, newest = getattr(self, name), Cat(values)[WORD * (fields - table.fields) :]
            shift = table.fields.bit_length() - 1
            address = Signal.like(port.addr, reset_less=True, name=f"{name}_address")
            writes = Signal(reset_less=True, name=f"{name}_writes")
            m.d.sync += [
                writes.eq(host.taken & (section == k) & place[:shift].all()),
                address.eq(place >> shift),
            ]
            m.d.comb += [
                port.en.eq(writes),
                port.addr.eq(address),
                port.data.eq(Cat(newest.word_select(j, WORD)[: table.bits] for j in range(table.fields))),
            ]
        return m
