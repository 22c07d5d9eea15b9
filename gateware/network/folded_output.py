# amaranth: UnusedElaboratable=no
"""The last layer's sums, one input after another: a multiplier with an accumulator for each neuron."""

from amaranth import Module, Mux, Shape, Signal, signed
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.shift_add import Term, partial_adder_tree, pipeline_register
from fastac.gateware.mlp_mvm import tile_layouts
from fastac.gateware.network.fold_plan import Series
from fastac.gateware.network.folded_parameters import Column, columns_reader, row_counter, write_signature
from fastac.models.integer.network import Layer
from fastac.models.integer.words import signed_width


class FoldedOutput(wiring.Component):
    """Compute `layer.weight @ i + layer.bias` for one vector every `fold` clocks, without a handshake.

    Members
    -------
    begins : bit k is high k − 1 clocks after a vector's first inputs are at `i`; vectors begin at least
        `fold` clocks after each other
    i : the series `arriving` of inputs, Shape(input_width, input_signed) each, |i[j]| <= layer.input_limit[j]
    o : accumulators with their biases, signed(layer.accumulator_width) each; all at once, for one clock
    write : write port of `columns`, see `write_signature`. Only if `layer.loadable`.

    `multipliers` = neurons · streams of the inputs. Each adds its products to its accumulator, as a DSP slice
    does from P to P, the first one to the bias; a tree adds those of a neuron.

    `latency` = clocks of the inputs + 2 + ceil(log2(streams of the inputs)) from a vector's first inputs.
    """

    def __init__(self, layer: Layer, *, input_width: int, input_signed: bool, fold: int):
        self.layer, self.fold = layer, fold
        neurons, inputs = layer.weight.shape
        self.arriving = Series(inputs, fold)
        tile_layouts(layer, input_width=input_width, input_signed=input_signed)
        members = {
            "begins": In(4),
            "i": In(data.ArrayLayout(Shape(input_width, input_signed), self.arriving.streams)),
            "o": Out(data.ArrayLayout(signed(layer.accumulator_width), neurons)),
        }
        if layer.loadable:
            members["write"] = In(write_signature(self.columns, fold))
        super().__init__(members)

    @staticmethod
    def multipliers_of(inputs: int, neurons: int, fold: int) -> int:
        """`multipliers` of a layer of these sizes."""
        return neurons * Series(inputs, fold).streams

    @property
    def latency(self) -> int:
        return self.arriving.sum_latency

    @property
    def multipliers(self) -> int:
        neurons, inputs = self.layer.weight.shape
        return self.multipliers_of(inputs, neurons, self.fold)

    @property
    def columns(self) -> list[Column]:
        """For each neuron the weights of each stream's inputs, and 0 where that is empty, then the bias."""
        layer, columns = self.layer, []
        for weights, bias in zip(layer.weight, layer.bias.tolist(), strict=True):
            for stream in range(self.arriving.streams):
                values = weights[self.arriving.on(stream)].tolist()
                values += [0] * (self.arriving.clocks - len(values))
                columns.append(Column(signed(layer.weight_bits), tuple(values)))
            limit = layer.bias_limit if layer.loadable else abs(bias)
            columns.append(Column(signed(signed_width(limit)), (bias,)))
        return columns

    def elaborate(self, platform):
        m = Module()
        layer, streams = self.layer, self.arriving.streams
        register = pipeline_register(m)
        read = columns_reader(m, self.columns, self.write if layer.loadable else None)
        row = row_counter(m, self.begins[0], self.fold, "row")
        # The first product is at its accumulator 2 clocks after its input.
        first = self.begins[3]

        for neuron in range(len(layer.weight)):
            number, sums = neuron * (streams + 1), []
            limit = layer.bias_limit if layer.loadable else abs(int(layer.bias[neuron]))
            bias = Term(read(number + streams, row), limit)
            for stream in range(streams):
                chosen, name = self.arriving.on(stream), f"{neuron}_{stream}"
                x = Signal(self.i[stream].shape(), reset_less=True, name=f"input_{name}")
                m.d.sync += x.eq(self.i[stream])
                weight = register(
                    Term(read(number + stream, row), layer.weight_limit), f"weight_{name}"
                ).value
                largest = abs(layer.weight[neuron, chosen]) if not layer.loadable else layer.weight_limit
                bounds = largest * layer.input_limit[chosen]
                product = register(Term(x * weight, int(bounds.max())), f"product_{name}").value
                most = int(bounds.sum()) + (bias.bound if stream == 0 else 0)
                total = Signal(signed(signed_width(most)), reset_less=True, name=f"accumulator_{name}")
                before = Mux(first, bias.value if stream == 0 else 0, total)
                m.d.sync += total.eq(before + product)
                sums.append(Term(total, most))
            [whole] = partial_adder_tree(sums, self.arriving.levels, register, f"sum_{neuron}")
            m.d.comb += self.o[neuron].eq(whole.value)
        return m
