"""Bench of a proof: a component whose inputs are free, with assumptions about them and assertions."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from amaranth import Const, Module, Signal, Value
from amaranth.back import rtlil
from amaranth.hdl import Assert, Assume, ResetSignal, ShapeLike
from amaranth.lib import stream, wiring
from amaranth.lib.wiring import In

_CHECK = re.compile(r'(?<=cell \$check )\S+(\n    parameter \\FORMAT "(.+)"\n)')
"""A cell of an assertion in RTLIL: its name, and the text of the assertion. Assumptions have no text."""


def ones(bits: Value) -> Value:
    """Number of ones."""
    return sum(bits, Const(0, 1))


@dataclass(frozen=True)
class Question:
    """What the solver is asked: the netlist of a bench, its probes by port, and its assertions' names."""

    rtlil: str
    probes: Mapping[str, str]
    assertions: tuple[str, ...]


class FormalBench:
    """A module around the component `dut`; whatever of the component's inputs is not driven here is free.

    A free input may take any value in any clock, the reset too: it is a port of the module. Registers of
    `m.d.sync` are reset together with the component, so that a property about the past begins anew there.

    Attributes
    ----------
    m : the Amaranth module, for further logic
    dut : the component
    reset : the reset of the domain sync
    """

    def __init__(self, dut: wiring.Component):
        self.m, self.dut = Module(), dut
        self.m.submodules.dut = dut
        self.reset = ResetSignal()
        self.probes: dict[str, str] = {}
        """Flattened name of an inner signal of the component, by the port that stands for it."""
        self.assertions: list[str] = []
        self._ports: list[Signal] = []
        self._driven: set[int] = set()

    def free(self, name: str, shape: ShapeLike = 1) -> Signal:
        """A signal that may take any value in any clock."""
        port = Signal(shape, name=name)
        self._ports.append(port)
        return port

    def probe(self, path: str, shape: ShapeLike = 1) -> Signal:
        """An inner signal of the component, for invariants; `path`: its name behind `dut.` in the netlist."""
        port = self.free(f"probe_{path.replace('.', '_').replace('[', '_').replace(']', '')}", shape)
        self.probes[port.name] = f"dut.{path}"
        return port

    def always(self, name: str, condition: Value) -> None:
        """Assert `condition` in every clock; `name` is what a failure prints."""
        self.assertions.append(name)
        self.m.d.comb += Assert(condition, name)

    def assume(self, condition: Value) -> None:
        """Restrict the free inputs to clocks in which `condition` holds."""
        self.m.d.comb += Assume(condition)

    def constant(self, name: str, values: range) -> Signal:
        """A signal with any of `values` that never changes, not even by a reset."""
        port = self.free(name, values)
        self.assume((port >= values.start) & (port < values.stop))
        before = Signal(values, name=f"{name}_before", reset_less=True)
        begun = Signal(name=f"{name}_begun", reset_less=True)
        self.m.d.sync += [before.eq(port), begun.eq(1)]
        self.assume(~begun | (port == before))
        return port

    def past(self, value: Value, name: str) -> Signal:
        """`value` a clock ago; its initial value, usually 0, after a reset."""
        register = Signal.like(Value.cast(value), name=name)
        self.m.d.sync += register.eq(value)
        return register

    def clocks(self, most: int) -> Signal:
        """Clocks since the last reset, `most` from then on."""
        clock = Signal(range(most + 1), name="clock")
        with self.m.If(clock != most):
            self.m.d.sync += clock.eq(clock + 1)
        return clock

    def drive(self, port: Value, value: Value) -> None:
        """Connect an input of the component to `value`."""
        self._driven.add(id(port))
        self.m.d.comb += Value.cast(port).eq(value)

    def held(self, name: str, valid: Value, ready: Value, payload: Value) -> tuple[Signal, Value]:
        """(A beat was offered and not taken a clock ago; if so it is still offered, unchanged.)"""
        waits = self.past(valid & ~ready, f"{name}_waits")
        before = Signal(len(Value.cast(payload)), name=f"{name}_before", reset_less=True)
        self.m.d.sync += before.eq(Value.cast(payload))
        return waits, ~waits | (valid & (before == Value.cast(payload)))

    def source(self, port, name: str) -> tuple[Signal, Signal]:
        """Offer beats at the input stream `port` by the rules of streams; returns (transfer, payload)."""
        valid, payload = (
            self.free(f"{name}_valid"),
            self.free(f"{name}_payload", len(Value.cast(port.payload))),
        )
        self.drive(port.valid, valid)
        self.drive(port.payload, payload)
        self.assume(self.held(name, valid, port.ready, payload)[1])
        return self.wire(f"{name}_moves", valid & port.ready), payload

    def sink(self, port, name: str) -> Signal:
        """Take beats of the output stream `port` at any time, assert the rules of streams; the transfer."""
        ready = self.free(f"{name}_ready")
        self.drive(port.ready, ready)
        self.always(
            f"{name}: valid holds and payload is stable until the beat is taken",
            self.held(name, port.valid, ready, port.payload)[1],
        )
        return self.wire(f"{name}_moves", port.valid & ready)

    def waited(self, due: Value, longest: int) -> Signal:
        """Clocks, up to `longest` and one more, that the ready output `o` has waited for a beat that is due.

        Clocks in which `o` is not ready do not count, as a reader that is fair does not stay so.
        """
        o = self.dut.o
        clocks = Signal(range(longest + 2), name="waited")
        with self.m.If(o.valid | ~due):
            self.m.d.sync += clocks.eq(0)
        with self.m.Elif(o.ready):
            self.m.d.sync += clocks.eq(clocks + 1)
        return clocks

    def wire(self, name: str, value: Value) -> Signal:
        """A name for `value` in waveforms of counterexamples."""
        signal = Signal.like(Value.cast(value), name=name)
        self.m.d.comb += signal.eq(value)
        return signal

    def streams(self) -> None:
        """`source` or `sink` for every stream of the component that is not driven yet."""
        for name, member in self.dut.signature.members.items():
            if member.is_port:
                continue
            ports = getattr(self.dut, name)
            for label, port in self._each(name, ports, member.dimensions):
                if isinstance(member.signature, stream.Signature) and id(port.valid) not in self._driven:
                    (self.source if member.flow == In else self.sink)(port, label)

    @staticmethod
    def _each(name: str, ports, dimensions) -> Iterator[tuple[str, object]]:
        if not dimensions:
            yield name, ports
            return
        for k, port in enumerate(ports):
            yield from FormalBench._each(f"{name}_{k}", port, dimensions[1:])

    def question(self) -> Question:
        """The module `top`: free inputs are its ports, assertion k of `assertions` is the cell check_k."""
        for path, member, value in self.dut.signature.flatten(self.dut):
            if member.flow == In and id(value) not in self._driven:
                self.drive(value, self.free("__".join(map(str, path)), len(Value.cast(value))))
        text = rtlil.convert(self.m, name="top", ports=self._ports, emit_src=False)
        text = _CHECK.sub(lambda cell: f"\\check_{self.assertions.index(cell[2])}{cell[1]}", text)
        return Question(text, self.probes, tuple(self.assertions))
