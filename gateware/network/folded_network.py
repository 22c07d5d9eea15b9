# amaranth: UnusedElaboratable=no
"""The pixel network (MLP) with few multipliers: a pixel every `fold` clocks, from features to a normal."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from amaranth import Cat, Module, Signal, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.network.fold_plan import Series
from fastac.gateware.network.folded_layer import FoldedLayer
from fastac.gateware.network.folded_output import FoldedOutput
from fastac.gateware.network.folded_parameters import Column, format_of, values_of
from fastac.gateware.network.folded_requantise import FoldedRequantise
from fastac.gateware.network.pixel_network import check_chain
from fastac.gateware.stream.handshake import check_folded, credit_handshake
from fastac.gateware.stream.tables import TableFormat
from fastac.models.integer.network import Layer


class FoldedMlp(wiring.Component):
    """Evaluate all layers for a pixel every `fold` clocks, bit-exact to the layers, as NormalMlp of one lane.

    Members
    -------
    i : stream of feature vectors, signed(input_width) per feature, |i[0][j]| <= layers[0].input_limit[j];
        a beat at most every `fold` clocks
    o : stream of normals (x, y, z), not normalised, signed(layers[-1].accumulator_width) each
    parameters : write port of `table`, see `TableFormat`; must not be used while pixels are in flight. Only
        if the layers are loadable.

    A hidden layer finds one neuron after another, so that its requantisation needs one multiplier for every
    `fold` neurons, and the next layer takes each activation as it comes; the last layer takes one after
    another and finds all of its neurons at once. Weights are in small memories; baked ones too, and they
    take the same multipliers.
    Beats that `o` does not take collect in a queue (`credit_handshake`).
    `latency` = 1 + Σ over layers of (clocks + 2 + ceil(log2(streams)) of the Series of its inputs)
    + 5·(layers − 1) clocks without back-pressure; `interval` = fold.
    """

    lanes = 1

    def __init__(self, layers: Sequence[Layer], *, input_width: int, fold: int):
        check_folded(fold)
        check_chain(layers)
        self.layers, self.input_width, self.fold, self.interval = tuple(layers), input_width, fold, fold
        self.loadable = layers[0].loadable
        self.latency = self.latency_of([layer.weight.shape[1] for layer in layers], fold)
        self.cores = self._cores()
        features = data.ArrayLayout(signed(input_width), layers[0].weight.shape[1])
        normal = data.ArrayLayout(signed(layers[-1].accumulator_width), 3)
        members = {
            "i": In(stream.Signature(data.ArrayLayout(features, 1))),
            "o": Out(stream.Signature(data.ArrayLayout(normal, 1))),
        }
        if self.loadable:
            members["parameters"] = In(self.table.signature)
        super().__init__(members)

    @staticmethod
    def latency_of(inputs: Sequence[int], fold: int) -> int:
        """`latency` of layers with these numbers of inputs."""
        sums = sum(Series(count, fold).sum_latency for count in inputs)
        return 1 + sums + FoldedRequantise.latency * (len(inputs) - 1)

    @staticmethod
    def multipliers_of(sizes: Sequence[int], fold: int) -> int:
        """`multipliers` of a network of these numbers of features, hidden neurons of each layer, and 3."""
        *hidden, last = pairwise(sizes)
        count = sum(FoldedLayer.multipliers_of(*layer, fold) for layer in hidden)
        count += sum(Series(neurons, fold).streams for _, neurons in hidden)
        return count + FoldedOutput.multipliers_of(*last, fold)

    @property
    def multipliers(self) -> int:
        """Multipliers of all cores, whether the weights are loadable or baked."""
        return sum(core.multipliers for core in self.cores.values())

    @property
    def columns(self) -> list[Column]:
        """The columns of all cores, in the order of the data."""
        return [column for core in self.cores.values() for column in core.columns]

    @property
    def table(self) -> TableFormat:
        """Format of the parameters as one table, see `format_of`."""
        return format_of(self.columns, self.fold)

    @property
    def table_values(self) -> np.ndarray:
        """The parameters of these layers as that table's values, (depth, 1)."""
        return values_of(self.columns, self.fold)

    def elaborate(self, platform):
        m = Module()
        last, ago = credit_handshake(m, self.i, self.o, self.latency, fold=self.fold)

        features = Signal(self.i.payload[0].shape(), reset_less=True)
        with m.If(ago[0]):
            m.d.sync += features.eq(self.i.payload[0])

        # `reached`: clocks from the acceptance of a beat until its first values are at the next core.
        x, reached, column = features, 1, 0
        for name, core in self.cores.items():
            m.submodules[name] = core
            m.d.comb += [
                core.begins.eq(Cat(ago[reached - 1 : reached - 1 + len(core.begins)])),
                core.i.eq(x),
            ]
            if self.loadable:
                write, host = core.write, self.parameters
                row, chosen = host.addr[: len(write.row)], host.addr[len(write.row) :]
                enables = [host.en & (chosen == column + k) for k in range(len(core.columns))]
                m.d.comb += [write.row.eq(row), write.data.eq(host.data), write.en.eq(Cat(enables))]
                column += len(enables)
            x, reached = core.o, reached + core.latency
        m.d.comb += last.payload[0].eq(x)
        assert reached == self.latency, f"latency {reached}: stated {self.latency}"
        return m

    def _cores(self) -> dict[str, FoldedLayer | FoldedRequantise | FoldedOutput]:
        """The cores by submodule name, in the order of the data."""
        cores, width, signed_input, fold = {}, self.input_width, True, self.fold
        for k, layer in enumerate(self.layers):
            kind = {"input_width": width, "input_signed": signed_input, "fold": fold}
            scale = layer.requantisation
            if scale is None:
                cores[f"fc{k}"] = FoldedOutput(layer, **kind)
                continue
            cores[f"fc{k}"] = FoldedLayer(layer, **kind, parallel=k == 0)
            cores[f"requantise{k}"] = FoldedRequantise(
                scale, width=layer.accumulator_width, fold=fold, loadable=layer.loadable
            )
            width, signed_input = scale.bits, False
        return cores
