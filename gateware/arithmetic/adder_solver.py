"""Searches adder graphs of constant matrices with da4ml (C. Sun et al., "da4ml: Distributed Arithmetic for
Real-time Neural Networks on FPGAs", 2025)."""

from functools import lru_cache

import numpy as np

from fastac.gateware.arithmetic.adder_graph import (
    AdderGraph,
    GraphBuilder,
    Operand,
    Range,
    with_cheapest_signs,
)

METHODS = ("wmc", "mc", "wmc-pdc", "mc-pdc")
"""How da4ml chooses which pair of digits to share next; none is the best for every matrix."""
DEEPER = 3
"""Depths that are tried for each method: as shallow as can be, and one and two additions more."""
COPY, ADD, SUBTRACT = -1, 0, 1
"""Operations of da4ml's solutions."""


def adder_graph(matrix: np.ndarray, inputs: list[Range], depth: int) -> AdderGraph:
    """The graph of fewest full adders that was found, with at most `depth` additions on any path.

    matrix : integers (outputs, inputs)
    Deterministic, and kept for the next call. Raises ValueError if `depth` is too small for all that were
    found: ceil(log2 of the most non-zero signed digits of a row) is always enough.
    """
    rows = tuple(map(tuple, np.asarray(matrix, np.int64).tolist()))
    return _search(rows, tuple(inputs), depth)


@lru_cache(maxsize=256)
def _search(rows: tuple[tuple[int, ...], ...], inputs: tuple[Range, ...], depth: int) -> AdderGraph:
    matrix = np.array(rows, np.int64)
    best, least, shallowest = None, None, None
    for method in METHODS:
        graph = None
        for more in range(DEEPER):
            last, graph = graph, _solve(matrix, inputs, method, more)
            if graph == last:
                break  # more depth is of no use
            shallowest = graph.depth if shallowest is None else min(shallowest, graph.depth)
            if graph.depth > depth:
                break  # the next are as deep or deeper
            bits = sum(graph.adder_bits(list(inputs)))
            if least is None or bits < least:
                best, least = graph, bits
    if best is None:
        raise ValueError(f"depth {depth}: expected at least {shallowest}")
    return best


def _solve(matrix: np.ndarray, inputs: tuple[Range, ...], method: str, more: int) -> AdderGraph:
    """da4ml's graph by a method, at most `more` additions deeper than the shallowest."""
    # Loaded here only: it takes a second, and designs with loadable weights do without.
    from da4ml.cmvm import solve

    # da4ml reads memory in order and ignores strides.
    kernel = np.ascontiguousarray(matrix.T, np.float32)
    # An input that is always 0 would lose its column.
    intervals = [(float(x.low), float(max(x.high, 1)), 1.0) for x in inputs]
    stages = solve(kernel, method0=method, hard_dc=more, qintervals=intervals).solutions
    builder = GraphBuilder(matrix.shape[1])
    values: list[Operand | None] = [Operand(node) for node in range(builder.inputs)]
    for stage in stages:
        buffer: list[Operand | None] = []
        for op in stage.ops:
            if op.opcode == COPY:
                buffer.append(_moved(values[op.id0], stage.inp_shifts[op.id0]))
                continue
            if op.opcode not in (ADD, SUBTRACT):
                raise ValueError(f"da4ml's opcode {op.opcode}: expected an addition or a subtraction")
            second = _moved(buffer[op.id1], op.data, op.opcode == SUBTRACT)
            buffer.append(_sum(builder, buffer[op.id0], second))
        values = [
            None if node < 0 else _moved(buffer[node], shift, bool(negative))
            for node, shift, negative in zip(stage.out_idxs, stage.out_shifts, stage.out_negs, strict=True)
        ]
    graph = with_cheapest_signs(builder.graph(values))
    graph.check(matrix)
    return graph


def _moved(value: Operand | None, shift: int, negate: bool = False) -> Operand | None:
    return None if value is None else Operand(value.node, value.shift + shift, value.negative != negate)


def _sum(builder: GraphBuilder, first: Operand | None, second: Operand | None) -> Operand | None:
    if first is None or second is None:
        return second if first is None else first
    return builder.add(first, second)
