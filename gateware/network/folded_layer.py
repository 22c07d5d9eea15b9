# amaranth: UnusedElaboratable=no
"""A hidden layer's sums, one neuron after another: chains of multipliers that each keep their input."""

import numpy as np
from amaranth import Module, Shape, Signal, signed
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.shift_add import Register, Term, partial_adder_tree, pipeline_register
from fastac.gateware.mlp_mvm import tile_layouts
from fastac.gateware.network.fold_plan import Series
from fastac.gateware.network.folded_parameters import Column, columns_reader, row_counter, write_signature
from fastac.models.integer.network import Layer
from fastac.models.integer.words import signed_width


class FoldedLayer(wiring.Component):
    """Compute `layer.weight @ i + layer.bias` for one vector every `fold` clocks, without a handshake.

    Parameters: `parallel`: whether all inputs are there at once, and stay for `fold` clocks, or come as the
    series `arriving`.

    Members
    -------
    begins : bit k is high k − 1 clocks after a vector's first inputs are at `i`; vectors begin at least
        `fold` clocks after each other
    i : inputs, Shape(input_width, input_signed) each, |i[j]| <= layer.input_limit[j]: all of them, or one for
        each stream of the series `arriving`
    o : the series `leaving` of accumulators with their biases, signed(layer.accumulator_width) each
    write : write port of `columns`, see `write_signature`. Only if `layer.loadable`.

    A multiplier takes one input when it arrives and keeps it for `fold` clocks, in which it multiplies it by
    the weights of one neuron after another. Each adds its product to the sum that the multiplier before it,
    whose input came one clock earlier, has found for the same neuron: a chain like that of DSP slices from
    P to PCIN. There is one chain for each stream of the inputs and of the neurons; a neuron's chains are
    added by a tree. `multipliers` = streams of the neurons · inputs.

    `latency` = clocks of the inputs + 2 + ceil(log2(streams of the inputs)) from a vector's first inputs to
    its first neurons.
    """

    def __init__(self, layer: Layer, *, input_width: int, input_signed: bool, fold: int, parallel: bool):
        self.layer, self.fold, self.parallel = layer, fold, parallel
        neurons, inputs = layer.weight.shape
        self.arriving, self.leaving = Series(inputs, fold), Series(neurons, fold)
        tile_layouts(layer, input_width=input_width, input_signed=input_signed)
        wires = inputs if parallel else self.arriving.streams
        accumulator = signed(layer.accumulator_width)
        members = {
            "begins": In(self.arriving.clocks + 1),
            "i": In(data.ArrayLayout(Shape(input_width, input_signed), wires)),
            "o": Out(data.ArrayLayout(accumulator, self.leaving.streams)),
        }
        if layer.loadable:
            members["write"] = In(write_signature(self.columns, fold))
        super().__init__(members)

    @staticmethod
    def multipliers_of(inputs: int, neurons: int, fold: int) -> int:
        """`multipliers` of a layer of these sizes."""
        return Series(neurons, fold).streams * inputs

    @property
    def latency(self) -> int:
        return self.arriving.sum_latency

    @property
    def multipliers(self) -> int:
        neurons, inputs = self.layer.weight.shape
        return self.multipliers_of(inputs, neurons, self.fold)

    @property
    def columns(self) -> list[Column]:
        """For each stream of neurons a weight for each input, then the bias, in the order of its neurons."""
        layer, columns = self.layer, []
        for stream in range(self.leaving.streams):
            chosen = self.leaving.on(stream)
            weights = layer.weight[chosen].T.tolist()
            columns += [Column(signed(layer.weight_bits), tuple(column)) for column in weights]
            biases = layer.bias[chosen].tolist()
            limit = layer.bias_limit if layer.loadable else max(map(abs, biases))
            columns.append(Column(signed(signed_width(limit)), tuple(biases)))
        return columns

    def elaborate(self, platform):
        m = Module()
        layer, arriving = self.layer, self.arriving
        register = pipeline_register(m)
        read = columns_reader(m, self.columns, self.write if layer.loadable else None)

        # The row of the multipliers whose input comes k clocks after the first.
        rows = [row_counter(m, self.begins[0], self.fold, "row_0")]
        for k in range(1, max(arriving.clocks, 2)):
            rows.append(Signal.like(rows[-1], name=f"row_{k}"))
            m.d.sync += rows[k].eq(rows[k - 1])

        kept = {}
        for clock in range(arriving.clocks):
            for stream in range(arriving.streams):
                if (j := arriving.at(clock, stream)) is not None:
                    x = self.i[j if self.parallel else stream]
                    kept[j] = Signal(x.shape(), reset_less=True, name=f"input_{j}")
                    with m.If(self.begins[clock + 1]):
                        m.d.sync += kept[j].eq(x)

        inputs = layer.weight.shape[1]
        for stream in range(self.leaving.streams):
            first = stream * (inputs + 1)
            chosen, name = self.leaving.on(stream), f"{stream}"
            largest = abs(layer.weight[chosen])
            if layer.loadable:
                largest = np.full_like(largest, layer.weight_limit)
            # The multipliers' products, and the largest magnitudes that each has for any neuron.
            products = []
            for j in range(inputs):
                weight = register(
                    Term(read(first + j, rows[j // arriving.streams]), layer.weight_limit),
                    f"weight_{name}_{j}",
                )
                bound = largest[:, j] * int(layer.input_limit[j])
                products.append(
                    (register(Term(kept[j] * weight.value, int(bound.max())), f"product_{name}_{j}"), bound)
                )
            limit = layer.bias_limit if layer.loadable else abs(layer.bias[chosen])
            bias = register(Term(read(first + inputs, rows[1]), int(np.max(limit))), f"bias_{name}")
            sums = []
            for source in range(arriving.streams):
                start = (bias, limit) if source == 0 else None
                sums.append(self._chain(products, source, start, register, f"{name}_{source}"))
            [total] = partial_adder_tree(sums, arriving.levels, register, f"sum_{name}")
            m.d.comb += self.o[stream].eq(total.value)
        return m

    def _chain(self, products, source: int, start, register: Register, name: str) -> Term:
        """The sum of the products of one stream of inputs, after `start`, each product a clock later."""
        total, reached = start or (None, 0)
        for clock in range(self.arriving.clocks):
            j = self.arriving.at(clock, source)
            if j is None:
                total = register(total, f"chain_{name}_{clock}")
                continue
            product, bound = products[j]
            reached = reached + bound
            most = int(np.max(reached))
            following = product if total is None else total.plus(product, most)
            total = register(following, f"chain_{name}_{clock}")
        return total
