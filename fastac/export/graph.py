"""An ONNX graph under construction: nodes, tables, and the integer operations that ONNX has no node for.

Words are int64 between stages. ONNX shifts unsigned integers only and rounds its quotients towards zero, so
`round_shift` lifts a word above zero by a power of two that its bound needs, shifts, and takes the lift off
again. Every bound is checked to leave int64 room, so that no operation can wrap around.
"""

from collections.abc import Mapping

import numpy as np
import onnx
from onnx import helper, numpy_helper

from fastac.models.integer.words import half_unit

OPSET, IR_VERSION = 18, 10
"""What files declare: old enough for runtimes of the last years, new enough for every operation here."""
FRAMES = "frames"
"""The name of the first dimension, of any size."""
Value = str | int | np.ndarray
"""A value of the graph by its name, or a constant; a Python integer is an int64."""


def kind_of(dtype) -> int:
    """ONNX's number of an element type."""
    return helper.np_dtype_to_tensor_dtype(np.dtype(dtype))


class Graph:
    """Nodes in order, tables, inputs and outputs; methods return the name of the value that they make."""

    def __init__(self, parent: "Graph | None" = None):
        """parent : of a loop's body, the graph around it, which keeps its tables and its names unique."""
        self.nodes: list[onnx.NodeProto] = []
        self.inputs: list[onnx.ValueInfoProto] = []
        self.outputs: list[onnx.ValueInfoProto] = []
        self.root: Graph = parent.root if parent else self
        self.tables: dict[tuple, onnx.TensorProto] = {}
        self._count = 0

    def new_name(self, stem: str) -> str:
        self.root._count += 1
        return f"{stem}_{self.root._count}"

    def table(self, values: int | np.ndarray) -> str:
        """A constant; equal ones are kept once."""
        array = np.asarray(values, np.int64) if isinstance(values, int) else np.ascontiguousarray(values)
        array = array.reshape(np.shape(values))  # a scalar stays one
        key = (array.dtype.str, array.shape, array.tobytes())
        if key not in self.root.tables:
            self.root.tables[key] = numpy_helper.from_array(array, self.new_name("table"))
        return self.root.tables[key].name

    def node(self, operation: str, *values: Value, **attributes) -> str:
        """A node with one output."""
        names = [value if isinstance(value, str) else self.table(value) for value in values]
        name = self.new_name(operation)
        self.nodes.append(helper.make_node(operation, names, [name], name=name, **attributes))
        return name

    def cast(self, value: Value, dtype) -> str:
        return self.node("Cast", value, to=kind_of(dtype))

    def input(self, name: str, dtype, shape: tuple, text: str = "") -> str:
        self.inputs.append(helper.make_tensor_value_info(name, kind_of(dtype), shape, text))
        return name

    def output(self, value: str, name: str, dtype, shape: tuple, text: str = "") -> None:
        """Give a value to the outside, as elements of `dtype`."""
        self.nodes.append(helper.make_node("Cast", [value], [name], name=name, to=kind_of(dtype)))
        self.outputs.append(helper.make_tensor_value_info(name, kind_of(dtype), shape, text))

    def axis_slices(self, value: str, places: Mapping[int, tuple[int, int]]) -> str:
        """Of each axis in `places` the elements from one index up to another."""
        starts, ends = zip(*places.values(), strict=True)
        return self.node("Slice", value, *(np.array(v, np.int64) for v in (starts, ends, [*places])))

    def sum_over(self, value: str, *axes: int) -> str:
        return self.node("ReduceSum", value, np.array(axes, np.int64), keepdims=0)

    def clip(self, value: str, low: int | None, high: int) -> str:
        """Words limited to low … high; None: no lower limit."""
        if low is not None:
            value = self.node("Max", value, low)
        return self.node("Min", value, high)

    def linear(self, value: str, matrix: np.ndarray, offset: np.ndarray | None, bound: int) -> str:
        """`value @ matrix + offset` of words, in int64; every partial sum is at most `bound`.

        int32 where it holds the bound, which is several times as fast.
        """
        require_room("product", bound)
        kind = np.int32 if bound < 1 << 31 else np.int64
        result = self.node("MatMul", self.cast(value, kind), matrix.astype(kind))
        if offset is not None:
            result = self.node("Add", result, offset.astype(kind))
        return self.cast(result, np.int64)

    def round_shift(
        self, value: str, shift: int | np.ndarray, rounding: str, bound: int, *, signed: bool = True
    ) -> str:
        """`words.round_shift` of words of at most `bound`; without `signed` they are 0 or more.

        shift : a scalar, or one for each element of the last axes
        """
        shift = np.asarray(shift, np.int64)
        half = np.asarray(half_unit(shift, rounding))
        lift_bits = max((bound + int(half.max())).bit_length(), int(shift.max())) if signed else 0
        require_room("word", bound + int(half.max()) + (1 << lift_bits if signed else 0))
        lift = np.int64(1 << lift_bits if signed else 0)
        if (half + lift).any():
            value = self.node("Add", value, half + lift)
        value = self.cast(value, np.uint64)
        value = self.cast(self.node("BitShift", value, shift.astype(np.uint64), direction="RIGHT"), np.int64)
        return self.node("Sub", value, lift >> shift) if signed else value

    def proto(self, name: str) -> onnx.GraphProto:
        tables = [*self.tables.values()] if self.root is self else []
        return helper.make_graph(self.nodes, name, self.inputs, self.outputs, tables)


def require_room(what: str, bound: int) -> None:
    """Raise ValueError where int64 might not hold a word."""
    if bound >= 1 << 62:
        raise ValueError(
            f"{what} bound {bound}: ONNX's int64 holds integers below 2**62 with room for rounding"
        )
