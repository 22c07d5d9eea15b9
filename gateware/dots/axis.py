"""The arithmetic of one axis of a dot: where it is looked for, which window is around it, and its centre."""

from amaranth import Cat, Const, Module, Mux, Signal, Value, signed
from amaranth.lib import data

from fastac.gateware.dots.multiple import multiple
from fastac.models.integer.dot_follower import FRACTION, DotFollower
from fastac.models.integer.dot_windows import CELL


def clipped(m: Module, value: Value, low, high, *, name: str):
    """`value`, which gets a name, but not below `low` nor above `high`."""
    named = Signal(value.shape(), name=name)
    m.d.comb += named.eq(value)
    return Mux(named < low, low, Mux(named > high, high, named))


def quotient_bits(follower: DotFollower) -> int:
    """Bits of the distance from a window's centre, in half pixels · 2**FRACTION; an even number of them."""
    largest = (CELL * (2 * follower.windows.half + 1) - 1) << FRACTION
    return largest.bit_length() + largest.bit_length() % 2


class DotAxis:
    """Registers of axis "u" or "v" of the dot that is followed; the methods give what is assigned to them.

    expected : the travel that its guides predict, in whole pixels
    place : column or row of the window that is read
    moved : the shift that is found, in px · 2**FRACTION
    """

    def __init__(self, follower: DotFollower, axis: str, place_bits: int):
        windows = follower.windows
        self.axis, self.half, self.bits = axis, windows.half, quotient_bits(follower)
        self.last = windows.shape["vu".index(axis)] - 1
        self.expected = Signal(signed(follower.width - FRACTION + 1), name=f"expected_{axis}")
        self.place = Signal(place_bits, name=f"place_{axis}")
        self.moved = Signal(signed(follower.width), name=f"moved_{axis}", reset_less=True)
        self.remainder = Signal(windows.mass_width, name=f"remainder_{axis}", reset_less=True)
        self.numerator = Signal(self.bits, name=f"numerator_{axis}", reset_less=True)
        self.quotient = Signal(self.bits, name=f"quotient_{axis}", reset_less=True)

    def expect(self, guides: list) -> list:
        """The mean of the guides' travels, halves upwards."""
        return [self.expected.eq((guides[0][self.axis] + guides[1][self.axis] + 1) >> 1)]

    def look(self, m: Module, record: data.View) -> list:
        """The window of the expected place, within the dot's reach."""
        pixel = (record[f"rest_{self.axis}"] + (1 << (FRACTION - 1))) >> FRACTION
        near = (pixel + self.expected) // CELL - self.half
        low, high = (record[f"{end}_{self.axis}"] for end in ("low", "high"))
        return [self.place.eq(clipped(m, near, low, high, name=f"near_{self.axis}"))]

    def step(self, m: Module, word: data.View) -> list:
        """The window around the centre of darkness in this one; see `DotFollower.step`."""
        mass, moment = word.mass, word[self.axis]
        edges = [2 * CELL * k + CELL for k in range(self.half)]
        beyond = sum((moment > multiple(mass, edge) for edge in edges), Const(0, 1))
        before = sum((moment < multiple(mass, -edge) for edge in edges), Const(0, 1))
        stepped = self.place + beyond - before
        return [self.place.eq(clipped(m, stepped, 0, self.last, name=f"stepped_{self.axis}"))]

    def start(self, word: data.View) -> list:
        """Begin |moment| · 2**FRACTION / mass. The upper bits are less than the mass, for |moment| is at most
        (4 · half + 1) · mass, so they are the first remainder.

        Without mass the quotient is undefined; such a dot is not seen.
        """
        moment = word[self.axis]
        scaled = Cat(Const(0, FRACTION), Mux(moment < 0, -moment, moment)[: len(moment)])
        return [
            self.numerator.eq(scaled[: self.bits]),
            self.remainder.eq(scaled[self.bits :]),
        ]

    def divide(self, mass) -> list:
        """Two steps of restoring division."""
        remainder, bits = self.remainder, []
        for bit in (self.numerator[-1], self.numerator[-2]):
            brought = Cat(bit, remainder)
            fits = brought >= mass
            remainder = Mux(fits, brought - mass, brought)[: len(self.remainder)]
            bits.append(fits)
        return [
            self.remainder.eq(remainder),
            self.numerator.eq(self.numerator << 2),
            self.quotient.eq(Cat(bits[1], bits[0], self.quotient)),
        ]

    def move(self, word: data.View, record: data.View) -> list:
        """The dot's shift: its window's centre and the rounded quotient, less its place at rest."""
        rounded = (self.quotient + 1) >> 1
        offset = Mux(word[self.axis] < 0, -rounded, rounded)
        centre = (multiple(self.place + self.half, 2 * CELL) + CELL - 1) << (FRACTION - 1)
        return [self.moved.eq(centre + offset - record[f"rest_{self.axis}"])]

    def travel(self, seen):
        """What later dots are told: the shift in whole pixels or, of a lost dot, what was expected."""
        return Mux(seen, (self.moved + (1 << (FRACTION - 1))) >> FRACTION, self.expected)
