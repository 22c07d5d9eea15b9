"""The matrix-vector tile of a fully connected layer, fully unrolled."""

from functools import reduce
from operator import add

from amaranth import Cat, Const, Module, Shape, Signal, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from models.fixed import signed_width
from models.integer import Layer


def adder_levels(inputs: int, group: int) -> list[int]:
    """How many terms an adder takes at each registered level: a group of products, then pairs of sums."""
    if group < 1:
        raise ValueError(f"group {group}: expected at least 1")
    groups = -(-inputs // group)
    return [group] + [2] * (groups - 1).bit_length()


def tile_layouts(
    layer: Layer, *, input_width: int, input_signed: bool
) -> tuple[data.ArrayLayout, data.ArrayLayout]:
    """Layouts of the inputs and of the accumulators of `layer`; refuses limits that no input can reach."""
    neurons, inputs = layer.weight.shape
    largest = 1 << (input_width - 1) if input_signed else (1 << input_width) - 1
    if layer.input_limit.max() > largest:
        raise ValueError(f"input_limit {layer.input_limit.max()}: expected at most {largest}")
    return (
        data.ArrayLayout(Shape(input_width, input_signed), inputs),
        data.ArrayLayout(signed(layer.accumulator_width), neurons),
    )


class MvmCore(wiring.Component):
    """`layer.weight @ i + layer.bias`, one vector a clock, without a handshake.

    Members
    -------
    advance : the registers move in clocks in which it is high
    i : inputs, Shape(input_width, input_signed) each, |i[j]| <= layer.input_limit[j]
    o : biased accumulators, signed(layer.accumulator_width) each

    One multiplier per neuron and input. The input (A, B), the product (M) and every sum (P) are registered:
    sums of `group` products, then a tree of two-operand adders, whose last one also adds the bias. A product
    or sum has signed_width(Σ|w|·input_limit) bits, over its own weights only.

    The accumulators stand in `o` after `latency` = 3 + ceil(log2(ceil(inputs/group))) advances.
    """

    def __init__(self, layer: Layer, *, input_width: int, input_signed: bool, group: int = 4):
        self.layer = layer
        self.levels = adder_levels(layer.weight.shape[1], group)
        i, o = tile_layouts(layer, input_width=input_width, input_signed=input_signed)
        super().__init__({"advance": In(1), "i": In(i), "o": Out(o)})

    @property
    def latency(self) -> int:
        """The input, its product, then the levels of adders: one register each."""
        return 2 + len(self.levels)

    @property
    def weights(self) -> list[list[Const]]:
        """One multiplier operand per neuron and input, each of signed(layer.weight_bits)."""
        word = signed(self.layer.weight_bits)
        return [[Const(int(w), word) for w in row] for row in self.layer.weight]

    def elaborate(self, platform):
        m = Module()

        def register(value, bound: int, name: str) -> tuple[Signal, int]:
            """`value`, at most ±`bound`, one advance later; data has no reset."""
            signal = Signal(signed(signed_width(bound)), reset_less=True, name=name)
            with m.If(self.advance):
                m.d.sync += signal.eq(value)
            return signal, bound

        inputs = Signal(self.i.shape(), reset_less=True)
        with m.If(self.advance):
            m.d.sync += inputs.eq(self.i)

        for k, weights in enumerate(self.weights):
            bounds = abs(self.layer.weight[k]) * self.layer.input_limit
            terms = [
                register(x * w, int(bound), f"product_{k}_{j}")
                for j, (x, w, bound) in enumerate(zip(inputs, weights, bounds, strict=True))
            ]
            bias = int(self.layer.bias[k])
            for level, size in enumerate(self.levels):
                groups = [terms[start : start + size] for start in range(0, len(terms), size)]
                if level == len(self.levels) - 1:
                    groups[0].append((bias, abs(bias)))
                terms = []
                for j, group in enumerate(groups):
                    values, bounds = zip(*group, strict=True)
                    terms.append(register(reduce(add, values), sum(bounds), f"sum{level}_{k}_{j}"))
            [(accumulator, _)] = terms
            m.d.comb += self.o[k].eq(accumulator)
        return m


class MvmTile(wiring.Component):
    """`layer.weight @ i + layer.bias`, one vector a clock: `MvmCore` between two streams.

    Members
    -------
    i : stream of inputs, Shape(input_width, input_signed) each, |i[j]| <= layer.input_limit[j]
    o : stream of biased accumulators, signed(layer.accumulator_width) each

    `latency` = 3 + ceil(log2(ceil(inputs/group))) clocks pass from an accepted vector to its accumulators if
    nothing stalls.
    """

    def __init__(self, layer: Layer, *, input_width: int, input_signed: bool, group: int = 4):
        self.layer, self.input_width, self.input_signed = layer, input_width, input_signed
        self.group = group
        self.latency = 2 + len(adder_levels(layer.weight.shape[1], group))
        i, o = tile_layouts(layer, input_width=input_width, input_signed=input_signed)
        super().__init__({"i": In(stream.Signature(i)), "o": Out(stream.Signature(o))})

    def elaborate(self, platform):
        m = Module()
        m.submodules.core = core = MvmCore(
            self.layer, input_width=self.input_width, input_signed=self.input_signed, group=self.group
        )
        assert self.latency == core.latency, f"latency {core.latency}: stated {self.latency}"

        # The core never stalls by itself; it moves whenever its last register may move.
        valid = Signal(self.latency)
        m.d.comb += [
            core.advance.eq(self.o.ready | ~self.o.valid),
            core.i.eq(self.i.payload),
            self.i.ready.eq(core.advance),
            self.o.payload.eq(core.o),
            self.o.valid.eq(valid[-1]),
        ]
        with m.If(core.advance):
            m.d.sync += valid.eq(Cat(self.i.valid, valid))
        return m
