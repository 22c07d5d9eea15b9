# amaranth: UnusedElaboratable=no
"""A netlist of Yosys as an Amaranth module, so that Amaranth's own simulator can run it."""

from collections.abc import Callable, Mapping
from itertools import groupby

from amaranth import (
    Cat,
    ClockDomain,
    ClockSignal,
    Const,
    Elaboratable,
    Module,
    Mux,
    ResetSignal,
    Signal,
    Value,
)

BINARY: dict[str, Callable[[Value, Value], Value]] = {
    "$and": lambda a, b: a & b,
    "$or": lambda a, b: a | b,
    "$xor": lambda a, b: a ^ b,
    "$xnor": lambda a, b: ~(a ^ b),
    "$add": lambda a, b: a + b,
    "$sub": lambda a, b: a - b,
    "$mul": lambda a, b: a * b,
    "$divfloor": lambda a, b: a // b,
    "$modfloor": lambda a, b: a % b,
    "$eq": lambda a, b: a == b,
    "$ne": lambda a, b: a != b,
    "$lt": lambda a, b: a < b,
    "$le": lambda a, b: a <= b,
    "$gt": lambda a, b: a > b,
    "$ge": lambda a, b: a >= b,
    "$logic_and": lambda a, b: a.any() & b.any(),
    "$logic_or": lambda a, b: a.any() | b.any(),
}
SHIFTS = ("$shl", "$sshl", "$shr", "$sshr", "$shift", "$shiftx")
UNARY: dict[str, Callable[[Value], Value]] = {
    "$not": lambda a: ~a,
    "$neg": lambda a: -a,
    "$pos": lambda a: a,
    "$logic_not": lambda a: ~a.any(),
    "$reduce_and": lambda a: a.all(),
    "$reduce_or": lambda a: a.any(),
    "$reduce_bool": lambda a: a.any(),
    "$reduce_xor": lambda a: a.xor(),
    "$reduce_xnor": lambda a: ~a.xor(),
}
IGNORED = ("$scopeinfo", "$print", "$check")


class Netlist(Elaboratable):
    """The design `module` of Yosys' JSON, with the signals in `ports` as its ports.

    Registers follow the domain sync, whatever drives the netlist's clock; its input `rst` is that of the
    domain. Memories must have been mapped to registers; what lies beyond their depth is driven by nothing
    and reads as 0, as in Amaranth's simulator.
    """

    def __init__(self, module: Mapping, ports: Mapping[str, Value]):
        self.module, self.ports = module, ports

    def elaborate(self, platform):
        m = Module()
        # Benches may wait for its clock even where no register is left.
        m.domains.sync = ClockDomain()
        self._bits: dict[object, tuple[Value, int]] = {}
        cells = [cell for cell in self.module["cells"].values() if cell["type"] not in IGNORED]
        registers = any(cell["type"] == "$dff" for cell in cells)
        for name, port in self.module["ports"].items():
            if port["direction"] == "input":
                self._define(port["bits"], self._input(name, registers))
        initial = self._initial_bits()
        outputs = []
        for cell in cells:
            output = cell["connections"]["Q" if cell["type"] == "$dff" else "Y"]
            init = sum(initial.get(bit, 0) << k for k, bit in enumerate(output))
            outputs.append(Signal(len(output), init=init, reset_less=True, name="cell"))
            self._define(output, outputs[-1])
        for cell, output in zip(cells, outputs, strict=True):
            if cell["type"] == "$dff":
                m.d.sync += output.eq(self._value(cell["connections"]["D"]))
            else:
                m.d.comb += output.eq(self._result(cell, len(output)))
        for name, port in self.module["ports"].items():
            if port["direction"] == "output":
                m.d.comb += self.ports[name].eq(self._value(port["bits"]))
        return m

    def _input(self, name: str, registers: bool) -> Value:
        if name in self.ports:
            return Value.cast(self.ports[name])
        if not registers:
            return Const(0, 1)
        return {"clk": ClockSignal(), "rst": ResetSignal(allow_reset_less=True)}[name]

    def _initial_bits(self) -> dict[object, int]:
        initial = {}
        for net in self.module["netnames"].values():
            text = net.get("attributes", {}).get("init")
            if text is not None:
                initial |= {
                    bit: int(value == "1")
                    for bit, value in zip(net["bits"], reversed(text), strict=False)
                    if value in "01"
                }
        return initial

    def _define(self, bits, value: Value) -> None:
        self._bits |= {bit: (value, k) for k, bit in enumerate(bits)}

    def _value(self, bits, is_signed: bool = False) -> Value:
        """The bits of a connection, put together from slices that are as long as possible."""
        places = [self._place(bit) for bit in bits]
        runs = groupby(enumerate(places), key=lambda item: (id(item[1][0]), item[1][1] - item[0]))
        parts = []
        for _, run in runs:
            chosen = [place for _, place in run]
            value, first = chosen[0]
            parts.append(value[first : first + len(chosen)])
        joined = parts[0] if len(parts) == 1 else Cat(*parts)
        return joined.as_signed() if is_signed else joined

    def _place(self, bit) -> tuple[Value, int]:
        if isinstance(bit, str):
            return (ONE, 0) if bit == "1" else (ZERO, 0)
        return self._bits.get(bit, (ZERO, 0))

    def _operands(self, cell, width: int = 0) -> list[Value]:
        """A, or A and B, signed if all of them are; each extended to `width` bits."""
        names = [name for name in ("A", "B") if name in cell["connections"]]
        is_signed = all(int(cell["parameters"][f"{name}_SIGNED"], 2) for name in names)
        found = []
        for name in names:
            bits = cell["connections"][name]
            filling = bits[-1] if is_signed else "0"
            found.append(self._value([*bits, *[filling] * (width - len(bits))], is_signed))
        return found

    def _result(self, cell, width: int) -> Value:
        kind, connections = cell["type"], cell["connections"]
        if kind == "$mux":
            return Mux(
                self._value(connections["S"]), self._value(connections["B"]), self._value(connections["A"])
            )
        if kind == "$pmux":
            result, choices = self._value(connections["A"]), connections["B"]
            for k, choose in enumerate(connections["S"]):
                chosen = self._value(choices[k * width : (k + 1) * width])
                result = Mux(self._value([choose]), chosen, result)
            return result
        if kind in UNARY:
            return UNARY[kind](*self._operands(cell, width))
        if kind in BINARY:
            return BINARY[kind](*self._operands(cell))
        if kind in SHIFTS:
            return self._shifted(cell, width)
        raise NotImplementedError(f"{kind}: no such cell in Amaranth's simulator")

    def _shifted(self, cell, width: int) -> Value:
        """A, extended by its own sign, shifted by B: to the left where `$shift` has a negative B."""
        connections, parameters = cell["connections"], cell["parameters"]
        a_signed, b_signed = (int(parameters[f"{name}_SIGNED"], 2) == 1 for name in ("A", "B"))
        bits = connections["A"]
        extended = [*bits, *[bits[-1] if a_signed else "0"] * (width - len(bits))]
        by = self._value(connections["B"])
        match cell["type"]:
            case "$shl" | "$sshl":
                return self._value(extended) << by
            case "$sshr":
                return self._value(extended, a_signed) >> by
            case "$shr":
                return self._value(extended) >> by
        right = self._value(extended) >> by
        if not b_signed:
            return right
        return Mux(by[-1], self._value(extended) << (-by.as_signed()).as_unsigned()[: len(by)], right)


ZERO, ONE = Const(0, 1), Const(1, 1)
