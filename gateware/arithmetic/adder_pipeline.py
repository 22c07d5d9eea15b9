"""Hardware of an adder graph: one addition between two registers, and every delay only once."""

from amaranth import Module, Signal, Value, signed, unsigned

from fastac.gateware.arithmetic.adder_graph import AdderGraph, Operand, Range
from fastac.gateware.arithmetic.shift_add import Term


def times(graph: AdderGraph, widths: list[int], latency: int) -> list[int]:
    """Clock, from 0 for the inputs to `latency`, in which each node's register holds its value.

    widths : bits of each node
    Chosen for few bits of delay: first every node as late as it can be, then one after another moved to where
    it and its operands wait least. Raises ValueError if `latency` is less than the graph's depth.
    """
    if graph.depth > latency:
        raise ValueError(f"latency {latency}: expected at least {graph.depth}, the depth of the graph")
    first = graph.inputs
    users: list[list[int]] = [[] for _ in widths]
    for k, pair in enumerate(graph.additions):
        for operand in pair:
            users[operand.node].append(first + k)
    kept = {o.node for o in graph.outputs if o is not None}
    found = [0] * len(widths)

    def last(node: int) -> int:
        """The clock in which the value is used for the last time."""
        return max([latency] if node in kept else [found[user] - 1 for user in users[node]], default=0)

    def latest(node: int) -> int:
        return min([latency] * (node in kept) + [found[user] - 1 for user in users[node]])

    for node in reversed(range(first, len(widths))):
        found[node] = latest(node)

    moved = True
    while moved:
        moved = False
        for node in range(first, len(widths)):
            operands = {operand.node for operand in graph.additions[node - first]}
            earliest = 1 + max(found[operand] for operand in operands)
            before, costs = found[node], {}
            for time in range(earliest, latest(node) + 1):
                found[node] = time
                costs[time] = sum((last(n) - found[n]) * widths[n] for n in (node, *operands))
            found[node] = min(costs, key=lambda time: (costs[time], -time))
            moved |= costs[found[node]] < costs[before]
            if costs[found[node]] == costs[before]:
                found[node] = before
    return found


def range_register(m: Module, value: Value, held: Range, name: str) -> Signal:
    """`value` one clock later, in the bits of its range, without a reset."""
    shape = signed(held.width) if held.signed else unsigned(held.width)
    signal = Signal(shape, reset_less=True, name=name)
    m.d.sync += signal.eq(value)
    return signal


def adder_pipeline(
    m: Module, graph: AdderGraph, inputs: list[tuple[Value, Range]], latency: int, name: str
) -> list[Term | None]:
    """The graph's outputs, `latency` clocks after its inputs; None for a row of zeros.

    A node's register has the bits of its exact range, without a reset.
    """
    ranges = graph.ranges([x for _, x in inputs])
    ready = times(graph, [x.width for x in ranges], latency)
    lines = [[value] for value, _ in inputs]

    def register(node: int, value: Value) -> None:
        line = lines[node]
        line.append(range_register(m, value, ranges[node], f"{name}_{node}_at{ready[node] + len(line)}"))

    def at(operand: Operand, time: int) -> Term:
        line = lines[operand.node]
        while ready[operand.node] + len(line) <= time:
            register(operand.node, line[-1])
        held = ranges[operand.node]
        bound = max(abs(held.low), abs(held.high)) << operand.shift
        return Term(line[time - ready[operand.node]], bound, operand.shift, operand.negative)

    for k, (first, second) in enumerate(graph.additions):
        node = graph.inputs + k
        time = ready[node] - 1
        total = at(first, time).plus(at(second, time), 0)
        assert (total.negative, total.shift) == (False, 0), "one operand is positive, and one not shifted"
        lines.append([])
        register(node, total.value)
    return [None if o is None else at(o, latency) for o in graph.outputs]
