"""Folding: how a component that takes a beat every few clocks spreads values over them."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Series:
    """A vector of `count` values that takes at most `fold` clocks, on as few streams as that allows.

    Value k is on stream k % streams in clock k // streams: only in the last clock may streams be empty.
    """

    count: int
    fold: int

    @property
    def streams(self) -> int:
        return -(-self.count // self.fold)

    @property
    def clocks(self) -> int:
        return -(-self.count // self.streams)

    @property
    def levels(self) -> int:
        """Levels of an adder tree over the streams."""
        return (self.streams - 1).bit_length()

    @property
    def sum_latency(self) -> int:
        """Clocks from the vector's first values to a weighted sum of them all: the values, a register each
        for operand and product, and the adder tree."""
        return self.clocks + 2 + self.levels

    def on(self, stream: int) -> list[int]:
        """The values on `stream`, in order."""
        return list(range(stream, self.count, self.streams))

    def at(self, clock: int, stream: int) -> int | None:
        """The value on `stream` in `clock`; None if it is empty."""
        k = clock * self.streams + stream
        return k if k < self.count else None
