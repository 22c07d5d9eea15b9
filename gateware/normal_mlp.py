"""The pixel network: features to surface normals, a chain of tiles for every lane."""

from collections.abc import Sequence
from itertools import pairwise

from amaranth import Cat, Module, Signal, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from models.integer import Layer

from .mlp_mvm import MvmCore, adder_levels
from .requantise import RequantiseCore

LANES = (1, 2, 4)


def _check_chain(layers: Sequence[Layer]) -> None:
    if len(layers[-1].weight) != 3 or layers[-1].requantisation is not None:
        raise ValueError(f"layers[-1] of {len(layers[-1].weight)} neurons: expected 3, not requantised")
    for k, (layer, following) in enumerate(pairwise(layers)):
        neurons, scale = len(layer.weight), layer.requantisation
        if scale is None or len(scale.multiplier) != neurons:
            raise ValueError(f"layers[{k}].requantisation {scale}: expected one multiplier for each neuron")
        if following.weight.shape[1] != neurons:
            raise ValueError(f"layers[{k + 1}] of {following.weight.shape[1]} inputs: expected {neurons}")
        top = (1 << scale.bits) - 1
        if following.input_limit.min() < top:
            raise ValueError(f"layers[{k + 1}].input_limit {following.input_limit.min()}: expected {top}")


class NormalMlp(wiring.Component):
    """`lanes` pixels a clock through all layers: matrix-vector tile, requantisation, …, last tile.

    Members
    -------
    i : stream of `lanes` feature vectors, signed(input_width) each, |i[lane][j]| <= layers[0].input_limit[j]
    o : stream of `lanes` normals (x, y, z) of any length, signed(layers[-1].accumulator_width) each

    Every lane has tiles of its own. All move with one `advance`, so the lanes are in lockstep and `ready`
    passes a single gate, whatever the number of layers.
    `latency` = Σ over layers of (3 + ceil(log2(ceil(inputs/group)))) + 3·(layers − 1) clocks pass from an
    accepted beat to its normals if nothing stalls.
    """

    def __init__(self, layers: Sequence[Layer], *, input_width: int, lanes: int, group: int = 4):
        if lanes not in LANES:
            raise ValueError(f"lanes {lanes}: expected one of {LANES}")
        _check_chain(layers)
        self.layers, self.input_width, self.lanes, self.group = tuple(layers), input_width, lanes, group
        self.latency = (
            sum(2 + len(adder_levels(layer.weight.shape[1], group)) for layer in layers)
            + (len(layers) - 1) * RequantiseCore.latency
        )
        features = data.ArrayLayout(signed(input_width), layers[0].weight.shape[1])
        normal = data.ArrayLayout(signed(layers[-1].accumulator_width), 3)
        super().__init__(
            {
                "i": In(stream.Signature(data.ArrayLayout(features, lanes))),
                "o": Out(stream.Signature(data.ArrayLayout(normal, lanes))),
            }
        )

    def elaborate(self, platform):
        m = Module()
        advance = Signal()
        valid = Signal(self.latency)
        m.d.comb += [
            advance.eq(self.o.ready | ~self.o.valid),
            self.i.ready.eq(advance),
            self.o.valid.eq(valid[-1]),
        ]
        with m.If(advance):
            m.d.sync += valid.eq(Cat(self.i.valid, valid))

        for lane in range(self.lanes):
            x, latency = self.i.payload[lane], 0
            for name, core in self._cores():
                m.submodules[f"{name}_lane{lane}"] = core
                m.d.comb += [core.advance.eq(advance), core.i.eq(x)]
                x, latency = core.o, latency + core.latency
            m.d.comb += self.o.payload[lane].eq(x)
            assert latency == self.latency, f"latency {latency} of lane {lane}: stated {self.latency}"
        return m

    def _cores(self):
        """One lane's cores with their names, in order."""
        width, signed_input = self.input_width, True
        for k, layer in enumerate(self.layers):
            yield (
                f"fc{k}",
                MvmCore(layer, input_width=width, input_signed=signed_input, group=self.group),
            )
            if layer.requantisation is not None:
                scale = layer.requantisation
                yield f"requantise{k}", RequantiseCore(scale, width=layer.accumulator_width)
                width, signed_input = scale.bits, False
