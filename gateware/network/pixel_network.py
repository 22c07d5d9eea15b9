# amaranth: UnusedElaboratable=no
"""The pixel network (MLP): from features to surface normals, one pipeline of layers for every lane."""

from collections.abc import Sequence
from itertools import pairwise

from amaranth import Module, signed, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.dsp_slice import DSP48E2, DspSlice
from fastac.gateware.mlp_mvm import MvmCore, accumulator_ranges, tile_latency
from fastac.gateware.network.requantise import RequantiseCore
from fastac.gateware.stream.handshake import check_lanes, credit_handshake
from fastac.gateware.target.elaboration import shared_instances
from fastac.models.integer.network import Layer


def check_chain(layers: Sequence[Layer]) -> None:
    """Raise ValueError unless each layer's activations are inputs of the next, and the last has 3 neurons."""
    if len(layers[-1].weight) != 3 or layers[-1].requantisation is not None:
        raise ValueError(f"layers[-1] of {len(layers[-1].weight)} neurons: expected 3, not requantised")
    for k, layer in enumerate(layers):
        if layer.loadable != layers[0].loadable:
            raise ValueError(
                f"layers[{k}].loadable {layer.loadable}: expected {not layer.loadable}, as the first"
            )
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
    """Evaluate all layers for `lanes` pixels per clock: matrix-vector tile, requantisation, …, last tile.

    Members
    -------
    i : stream of `lanes` feature vectors, signed(input_width) per feature, |i[lane][j]| <=
        layers[0].input_limit[j]
    o : stream of `lanes` normals (x, y, z), not normalised, signed(layers[-1].accumulator_width) each
    parameters : weights, biases and scales of all layers, unsigned(parameter_bits), as `parameter_image`
        packs them; constant while pixels are in flight. Only if the layers are loadable.

    dsp : the DSP slice that products are packed for, which the layout of the parameters follows

    Every lane has its own tiles, which share the parameters. No register has a clock enable, and `ready`
    comes from a register: beats that `o` does not take collect in a queue (`credit_handshake`).
    `latency` = Σ over layers of (5 + ceil(log2(inputs))) + 6·(layers − 1) clocks without back-pressure,
    loadable or baked; initiation interval 1.
    """

    def __init__(self, layers: Sequence[Layer], *, input_width: int, lanes: int, dsp: DspSlice = DSP48E2):
        check_lanes(lanes)
        check_chain(layers)
        self.layers, self.input_width, self.lanes = tuple(layers), input_width, lanes
        self.loadable, self.dsp = layers[0].loadable, dsp
        self.latency = self.latency_of([layer.weight.shape[1] for layer in layers])
        self.cores = [self._lane() for _ in range(lanes)]
        features = data.ArrayLayout(signed(input_width), layers[0].weight.shape[1])
        normal = data.ArrayLayout(signed(layers[-1].accumulator_width), 3)
        members = {
            "i": In(stream.Signature(data.ArrayLayout(features, lanes))),
            "o": Out(stream.Signature(data.ArrayLayout(normal, lanes))),
        }
        if self.loadable:
            members["parameters"] = In(unsigned(self.parameter_bits))
        super().__init__(members)

    @staticmethod
    def latency_of(inputs: Sequence[int]) -> int:
        """`latency` of layers with these numbers of inputs."""
        return sum(map(tile_latency, inputs)) + (len(inputs) - 1) * RequantiseCore.latency

    @property
    def multipliers(self) -> int:
        """Multipliers of all lanes; 0 if the weights are baked in."""
        return sum(core.multipliers for lane in self.cores for core in lane.values())

    @property
    def parameter_bits(self) -> int:
        """Bits of `parameters`; 0 if the weights are baked in."""
        return sum(core.parameter_bits for core in self.cores[0].values())

    def parameter_image(self, layers: Sequence[Layer]) -> int:
        """The value of `parameters` for `layers`, of the same shapes and limits as the hardware's.

        From bit 0: for each layer the parameters of its MvmCore, then those of its RequantiseCore.
        Raises ValueError if the shapes or limits differ.
        """
        if len(layers) != len(self.layers):
            raise ValueError(f"{len(layers)} layers: expected {len(self.layers)}")
        check_chain(layers)
        tables = [table for layer in layers for table in (layer, layer.requantisation) if table is not None]
        image, low = 0, 0
        for core, table in zip(self.cores[0].values(), tables, strict=True):
            image |= core.parameter_image(table) << low
            low += core.parameter_bits
        return image

    def elaborate(self, platform):
        m = Module()
        last, _ = credit_handshake(m, self.i, self.o, self.latency)

        for name in self.cores[0]:
            for lane, core in enumerate(shared_instances([cores[name] for cores in self.cores], name)):
                m.submodules[f"{name}_lane{lane}"] = core
        for lane, cores in enumerate(self.cores):
            x, latency, low = self.i.payload[lane], 0, 0
            for core in cores.values():
                m.d.comb += core.i.eq(x)
                if self.loadable:
                    m.d.comb += core.parameters.eq(self.parameters[low : low + core.parameter_bits])
                x, latency, low = core.o, latency + core.latency, low + core.parameter_bits
            m.d.comb += last.payload[lane].eq(x)
            assert latency == self.latency, f"latency {latency} of lane {lane}: stated {self.latency}"
        return m

    def _lane(self) -> dict[str, MvmCore | RequantiseCore]:
        """One lane's cores by submodule name, in the order of the data."""
        cores, width, signed_input = {}, self.input_width, True
        for k, layer in enumerate(self.layers):
            cores[f"fc{k}"] = MvmCore(layer, input_width=width, input_signed=signed_input, dsp=self.dsp)
            if layer.requantisation is not None:
                scale = layer.requantisation
                reached = accumulator_ranges(layer, input_signed=signed_input)
                cores[f"requantise{k}"] = RequantiseCore(
                    scale,
                    width=layer.accumulator_width,
                    loadable=layer.loadable,
                    largest=None if layer.loadable else [x.high for x in reached],
                )
                width, signed_input = scale.bits, False
        return cores
