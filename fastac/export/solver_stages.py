"""The stages of the integer Poisson solvers as ONNX: sine transform, division by eigenvalues, recurrences."""

import numpy as np
from onnx import helper

from fastac.export.graph import FRAMES, Graph, kind_of
from fastac.models.integer.dst2d import MANTISSA_BITS, EigenvalueDivision
from fastac.models.integer.sine_transform import SineTransform
from fastac.models.integer.solver_base import IntegerSolver
from fastac.models.integer.tridiagonal import Elimination, Recurrence, Substitution


def solution(graph: Graph, solver: IntegerSolver, source: str) -> str:
    """The solver's words (frames, N, N) for the source's, (frames, N, N).

    Raises ValueError for a stage that has no ONNX here.
    """
    words = source
    for name, stage in solver.parts.items():
        if name in solver.transposed_before:
            words = graph.node("Transpose", words, perm=[0, 2, 1])
        if type(stage) not in STAGES:
            raise ValueError(f"solver stage {name}: no ONNX for {type(stage).__name__}")
        words = STAGES[type(stage)](graph, stage, words)
    return words


def _sines(graph: Graph, stage: SineTransform, words: str) -> str:
    sums = graph.linear(words, stage.matrix, None, stage.accumulator_bound)
    return graph.round_shift(sums, stage.shift, stage.rounding, stage.accumulator_bound)


def _division(graph: Graph, stage: EigenvalueDivision, words: str) -> str:
    products = graph.node("Mul", words, -stage.mantissa)
    return graph.round_shift(
        products, stage.shift, stage.rounding, _largest(stage.input_width) << MANTISSA_BITS
    )


def _elimination(graph: Graph, stage: Elimination, words: str) -> str:
    bound = (_largest(stage.input_width) + _largest(stage.output_width)) << stage.shift

    def row(body: Graph, above: str, given: str, coefficient: str) -> str:
        product = body.node("Mul", coefficient, body.node("Sub", above, given))
        return body.round_shift(product, stage.shift, stage.rounding, bound)

    return _over_rows(graph, stage, words, row)


def _substitution(graph: Graph, stage: Substitution, words: str) -> str:
    gain = 1 << (stage.shift - stage.drop)
    bound = (_largest(stage.output_width) << stage.shift) + _largest(stage.input_width) * gain

    def row(body: Graph, below: str, given: str, coefficient: str) -> str:
        total = body.node("Add", body.node("Mul", coefficient, below), body.node("Mul", given, gain))
        return body.round_shift(total, stage.shift, stage.rounding, bound)

    return _over_rows(graph, stage, words, row)


def _over_rows(graph: Graph, stage: Recurrence, words: str, row) -> str:
    """A recurrence over the rows of words (frames, N, N), from zero on.

    row : makes the nodes of one row, from the row found before, the row that is given, and its coefficients
    """
    before, given, coefficient = (graph.new_name(stem) for stem in ("before", "given", "coefficient"))
    body, line, backwards = Graph(parent=graph), (FRAMES, stage.size), int(not stage.downwards)
    body.input(before, np.int64, line)
    body.input(given, np.int64, line)
    body.input(coefficient, np.int64, (stage.size,))
    found = row(body, before, given, coefficient)
    for name in (found, body.node("Identity", found)):  # what the next row is given, and what is kept
        body.outputs.append(helper.make_tensor_value_info(name, kind_of(np.int64), line))
    zero = graph.node("Mul", graph.node("Gather", words, 0, axis=1), 0)
    kept, last = graph.new_name("rows"), graph.new_name("last_row")
    graph.nodes.append(
        helper.make_node(
            "Scan",
            [zero, words, graph.table(stage.coefficient)],
            [last, kept],
            name=kept,
            body=body.proto(graph.new_name("row")),
            num_scan_inputs=2,
            scan_input_axes=[1, 0],
            scan_input_directions=[backwards, backwards],
            scan_output_axes=[1],
            scan_output_directions=[backwards],
        )
    )
    return kept


def _largest(width: int) -> int:
    """The largest magnitude of a signed word of `width` bits."""
    return 1 << (width - 1)


STAGES = {
    SineTransform: _sines,
    EigenvalueDivision: _division,
    Elimination: _elimination,
    Substitution: _substitution,
}
"""What makes the nodes of each class of stage: (graph, stage, words) to words."""
