# amaranth: UnusedElaboratable=no
"""Products of a pixel's values with its weights, several clocks a pixel, so that they share multipliers."""

from dataclasses import dataclass

import numpy as np
from amaranth import Cat, Const, Module, Mux, Shape, Signal, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.dsp_slice import DspSlice
from fastac.gateware.arithmetic.frame_sum import adder_tree, tree_levels
from fastac.gateware.arithmetic.product import LATENCY as PRODUCT_LATENCY
from fastac.gateware.arithmetic.product import product
from fastac.gateware.force.block_address import BlockAddress
from fastac.gateware.force.weight_rom import WeightRom
from fastac.gateware.stream.handshake import check_folded
from fastac.models.integer.words import signed_width


@dataclass(frozen=True)
class Share:
    """Multipliers that work on some of the axes: in each slot, a clock of a pixel, they find a part of one
    axis' sum.

    In slot s multiplier k has axis `first` + s mod `axes` and the value (s div axes) · multipliers + k, or
    none if there is none. So the axes come in turn, `rounds` times.
    """

    first: int
    axes: int
    multipliers: int
    rounds: int

    @property
    def slots(self) -> int:
        return self.axes * self.rounds

    def value(self, round_: int, multiplier: int) -> int:
        return round_ * self.multipliers + multiplier


def shares_of(axes: int, values: int, fold: int) -> tuple[Share, ...]:
    """How the products of a pixel, axes · values, are shared: with the fewest multipliers in `fold` clocks.

    The axes are split into as many shares as that needs. A share of a axes has floor(fold/a) rounds and
    ceil(values/rounds) multipliers. With up to three axes and three values this comes to
    ceil(axes · values/fold), and with patches of three axes to one more at most.
    """
    found = []
    for count in range(-(-axes // fold), axes + 1):
        shares = []
        for part in np.array_split(np.arange(axes), count):
            multipliers = -(-values // (fold // len(part)))
            rounds = -(-values // multipliers)
            shares.append(Share(int(part[0]), len(part), multipliers, rounds))
        found.append(tuple(shares))
    return min(found, key=lambda shares: sum(share.multipliers for share in shares))


def slots_of(axes: int, values: int, fold: int) -> int:
    """Clocks of a pixel in which products are found: those of the longest share."""
    return max(share.slots for share in shares_of(axes, values, fold))


def products_latency(axes: int, values: int, fold: int) -> int:
    """Clocks from a pixel to the sum of its last slot."""
    shares = shares_of(axes, values, fold)
    levels = tree_levels(max(share.multipliers for share in shares))
    return WeightRom.latency + PRODUCT_LATENCY + levels + slots_of(axes, values, fold) - 1


def shared_multipliers(
    axes: int, values: int, fold: int, *, input_bits: int, weight_bits: int, dsp: DspSlice
) -> int:
    """DSP slices: the multipliers of `shares_of`, of `dsp.slices(input_bits, weight_bits)` slices each."""
    multipliers = sum(share.multipliers for share in shares_of(axes, values, fold))
    return multipliers * dsp.slices(input_bits, weight_bits)


def _chosen(words: list, place):
    """The word at `place`; of its bits only those count that tell the words apart."""
    if len(words) == 1:
        return words[0]
    return Cat(words).word_select(place[: (len(words) - 1).bit_length()], len(words[0]))


class SharedProducts(wiring.Component):
    """Multiply the values of a pixel with its weights, a part of one axis' products in each clock.

    Parameters: `weight` (pixels, axes, terms) or, with `squares`, of each square of pixels; `terms`, for each
    value the terms whose weights it has: one, or two of which `second` chooses; `shape` and `limit` of a
    value, |value| <= limit.

    Members
    -------
    advance : clock enable of all registers
    i : stream of pixels, an array of values each; a pixel is taken every `fold` clocks at most, and only
        while `advance` is high
    second : chooses the second weight where there are two; belongs to the pixel at `i`
    parts : for each share (see `Share`) the sum of its products in a slot, signed(widths[share]), with
        `valid`, and in the pixel's last slot `ends_pixel`, in the frame's last one `ends_frame`

    `latency` = 5 + ceil(log2(multipliers)) + slots − 1 clocks from a pixel to the sum of its last slot,
    without back-pressure, with the multipliers of the largest and the slots of the longest share: 2 for the
    ROM, 3 for the products, the adder tree, and the slots before the last. All shares are in step.
    """

    def __init__(
        self,
        weight: np.ndarray,
        terms: list[tuple[int, ...]],
        *,
        shape: Shape,
        limit: int,
        fold: int,
        squares: BlockAddress | None = None,
    ):
        check_folded(fold)
        self.squares = squares
        self.weight, self.terms, self.shape, self.limit, self.fold = weight, terms, shape, limit, fold
        self.axes, self.values = weight.shape[1], len(terms)
        self.shares = shares_of(self.axes, self.values, fold)
        layouts = [
            data.StructLayout({"sum": signed(width), "valid": 1, "ends_pixel": 1, "ends_frame": 1})
            for width in self.widths
        ]
        super().__init__(
            {
                "advance": In(1),
                "i": In(stream.Signature(data.ArrayLayout(shape, self.values))),
                "second": In(1),
            }
            | {f"part_{k}": Out(layout) for k, layout in enumerate(layouts)}
        )

    @property
    def parts(self) -> list:
        return [getattr(self, f"part_{k}") for k in range(len(self.shares))]

    @property
    def widths(self) -> list[int]:
        """Bits of each share's sums."""
        bounds = (self._bounds(share) for share in self.shares)
        return [signed_width(int(bound.sum(axis=1).max())) for bound in bounds]

    @property
    def levels(self) -> int:
        """Of the adder trees; the smaller ones are as late."""
        return tree_levels(max(share.multipliers for share in self.shares))

    @property
    def latency(self) -> int:
        return products_latency(self.axes, self.values, self.fold)

    def _bounds(self, share: Share) -> np.ndarray:
        """The largest magnitude of each multiplier's product in each slot of each pixel, (…, multipliers)."""
        of_share = self.weight[:, share.first : share.first + share.axes]
        largest = [np.abs(of_share[..., list(terms)]).max(axis=-1) for terms in self.terms]
        idle = share.rounds * share.multipliers - self.values
        largest += [np.zeros_like(largest[0])] * idle
        bounds = np.stack(largest, axis=-1) * self.limit
        return bounds.reshape(-1, share.multipliers)

    def elaborate(self, platform):
        m = Module()
        count, _, terms = self.weight.shape
        m.submodules.weights = weights = WeightRom(
            self.weight.reshape(count, self.axes * terms), self.squares
        )
        slot, busy = Signal(range(self.fold)), Signal()
        second, ends_frame = Signal(reset_less=True), Signal(reset_less=True)
        pixel = Signal(self.i.payload.shape(), reset_less=True)
        free, last_slot = Signal(), slot == self.fold - 1
        m.d.comb += [
            free.eq(~busy | last_slot),
            self.i.ready.eq(self.advance & free),
            weights.advance.eq(self.advance),
            weights.take.eq(self.i.valid & free),
        ]
        with m.If(self.advance):
            m.d.sync += slot.eq(Mux(last_slot | ~busy, 0, slot + 1))
            with m.If(free):
                m.d.sync += busy.eq(self.i.valid)
                with m.If(self.i.valid):
                    m.d.sync += [
                        pixel.eq(self.i.payload),
                        second.eq(self.second),
                        ends_frame.eq(weights.last),
                    ]

        # A slot's weights are at the ROM's output a clock after its values are in `pixel`.
        slot_behind, second_behind = Signal.like(slot, reset_less=True), Signal(reset_less=True)
        with m.If(self.advance):
            m.d.sync += [slot_behind.eq(slot), second_behind.eq(second)]

        fields = list(weights.word)
        words = [fields[k * terms : (k + 1) * terms] for k in range(self.axes)]
        for k, (share, part) in enumerate(zip(self.shares, self.parts, strict=True)):
            bounds = self._bounds(share)
            products = []
            for multiplier in range(share.multipliers):
                name = f"share_{k}_{multiplier}"
                value = Signal(self.shape, reset_less=True, name=f"{name}_value")
                with m.If(self.advance):
                    m.d.sync += value.eq(self._value(pixel, share, multiplier, slot))
                weight = Signal(signed(weights.width), name=f"{name}_weight")
                m.d.comb += weight.eq(self._weight(words, share, multiplier, slot_behind, second_behind))
                whole = product(m, platform, self.advance, value, weight, name=f"{name}_product")
                width = signed_width(int(bounds[:, multiplier].max()))
                products.append(whole[:width].as_signed())
            total = adder_tree(m, self.advance, products, bounds, f"share_{k}")

            ends_pixel = Signal(name=f"share_{k}_ends_pixel")
            m.d.comb += ends_pixel.eq(busy & (slot == share.slots - 1))
            valid = busy & (slot < share.slots)
            flags = Cat(valid, ends_pixel, ends_pixel & ends_frame)
            for stage in range(PRODUCT_LATENCY + 1 + tree_levels(share.multipliers)):
                flags = self._later(m, flags, f"share_{k}_flags_{stage}", reset_less=False)
            for stage in range(self.levels - tree_levels(share.multipliers)):
                total = self._later(m, total, f"share_{k}_total_{stage}")
                flags = self._later(m, flags, f"share_{k}_waits_{stage}", reset_less=False)
            m.d.comb += [part.sum.eq(total), Cat(part.valid, part.ends_pixel, part.ends_frame).eq(flags)]
        return m

    def _later(self, m: Module, value, name: str, *, reset_less: bool = True) -> Signal:
        """`value` a clock later."""
        register = Signal(value.shape(), reset_less=reset_less, name=name)
        with m.If(self.advance):
            m.d.sync += register.eq(value)
        return register

    def _value(self, pixel, share: Share, multiplier: int, slot):
        """The value that a multiplier has in a slot; where it has none any, as its weight is 0."""
        values = range(multiplier, self.values, share.multipliers)
        last = len(values) - 1
        if last == 0:
            return pixel[values[0]]
        rounds = [Const(min(s // share.axes, last), range(len(values))) for s in range(share.slots)]
        value = _chosen([pixel[value] for value in values], _chosen(rounds, slot))
        return value.as_signed() if self.shape.signed else value

    def _weight(self, words: list, share: Share, multiplier: int, slot, second):
        """The weight that a multiplier has in a slot."""
        each = []
        for s in range(share.slots):
            round_, axis = divmod(s, share.axes)
            value, word = share.value(round_, multiplier), words[share.first + axis]
            if value < self.values:
                first, *other = (word[term] for term in self.terms[value])
                each.append(Mux(second, other[0], first) if other else first)
            else:
                each.append(Const(0, signed(len(word[0]))))
        return _chosen(each, slot).as_signed()
