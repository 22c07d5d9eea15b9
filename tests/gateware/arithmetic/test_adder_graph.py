import numpy as np
import pytest

from fastac.gateware.arithmetic.adder_graph import (
    AdderGraph,
    GraphBuilder,
    Operand,
    Range,
    free_bits,
    with_cheapest_signs,
)

GRAPH = AdderGraph(
    2,
    (
        (Operand(0), Operand(1, 2)),  # node 2: x + 4y
        (Operand(2, 1), Operand(0, negative=True)),  # node 3: x + 8y
        (Operand(3), Operand(2, 3, negative=True)),  # node 4: -7x - 24y
    ),
    (Operand(4, 1, negative=True), None, Operand(3)),
)
INPUTS = [Range(0, 5), Range(-4, 3)]


@pytest.mark.parametrize(
    ("low", "high", "width", "signed"),
    [
        *((0, 0, 1, False), (0, 255, 8, False), (0, 256, 9, False), (-1, 0, 1, True)),
        *((-8, 7, 4, True), (-9, 7, 5, True), (-8, 8, 5, True), (-1, 127, 8, True)),
    ],
)
def test_words_of_ranges(low, high, width, signed):
    assert (Range(low, high).width, Range(low, high).signed) == (width, signed)


def test_matrix_and_depth():
    assert GRAPH.matrix.tolist() == [[14, 48], [0, 0], [1, 8]]
    assert (GRAPH.depths, GRAPH.depth) == ([0, 0, 1, 2, 3], 3)
    GRAPH.check(GRAPH.matrix)
    with pytest.raises(ValueError, match="adder graph of 3 additions: multiplies by another matrix"):
        GRAPH.check(GRAPH.matrix + 1)


def test_both_ends_of_every_range_are_reached():
    ranges = GRAPH.ranges(INPUTS)
    reached = np.array([[x, y] for x in range(6) for y in range(-4, 4)])
    for held, row in zip(ranges, GRAPH.coefficients, strict=True):
        values = reached @ row
        assert (held.low, held.high) == (values.min(), values.max())


def test_low_bits_of_one_operand_need_no_adder():
    assert free_bits(Operand(0), Operand(1, 3)) == 3
    assert free_bits(Operand(0, 2), Operand(1)) == 2
    assert free_bits(Operand(0), Operand(1, 3, negative=True)) == 3
    assert free_bits(Operand(0, 3), Operand(1, negative=True)) == 0
    assert free_bits(Operand(0), Operand(1)) == 0
    widths = [held.width for held in GRAPH.ranges(INPUTS)]
    assert GRAPH.adder_bits(INPUTS) == [widths[2] - 2, widths[3], widths[4] - 3]


def test_signs_that_need_fewer_adders():
    """8y − x and what follows from it: as x − 8y it has three adders less."""
    graph = AdderGraph(
        2,
        (
            (Operand(0, negative=True), Operand(1, 3)),
            (Operand(2), Operand(0, 5)),
            (Operand(2, 4), Operand(2, negative=True)),
        ),
        (Operand(3), Operand(4, 1)),
    )
    cheaper = with_cheapest_signs(graph)
    cheaper.check(graph.matrix)
    assert cheaper.outputs == graph.outputs
    assert sum(cheaper.adder_bits(INPUTS)) < sum(graph.adder_bits(INPUTS))
    for first, second in cheaper.additions:
        assert not (first.negative and second.negative)


class TestBuilder:
    def test_equal_sums_are_one_node(self):
        builder = GraphBuilder(2)
        total = builder.add(Operand(0), Operand(1, 1))
        assert total == Operand(2)
        assert builder.add(Operand(1, 4), Operand(0, 3)) == Operand(2, 3)
        assert builder.add(Operand(1, 1, negative=True), Operand(0, negative=True)) == Operand(2, 0, True)
        assert builder.add(Operand(0), Operand(0)) == Operand(0, 1)
        assert builder.add(Operand(1, 2), Operand(1, 2, negative=True)) is None
        assert len(builder.additions) == 1

    def test_only_what_outputs_need(self):
        builder = GraphBuilder(2)
        builder.add(Operand(0), Operand(1))
        kept = builder.add(Operand(0), Operand(1, negative=True))
        graph = builder.graph([None, Operand(kept.node, 2, True)])
        assert len(graph.additions) == 1
        assert graph.matrix.tolist() == [[0, 0], [-4, 4]]
