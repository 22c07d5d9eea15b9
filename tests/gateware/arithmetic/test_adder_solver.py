import numpy as np
import pytest

from fastac.gateware.arithmetic import adder_solver
from fastac.gateware.arithmetic.adder_graph import Range
from fastac.gateware.arithmetic.adder_solver import adder_graph
from fastac.gateware.arithmetic.shift_add import canonical_signed_digits


def least_depth(matrix: np.ndarray) -> int:
    digits = max(sum(len(canonical_signed_digits(w)) for w in row) for row in matrix.tolist())
    return max(digits - 1, 0).bit_length()


@pytest.mark.parametrize("bits", [2, 8, 12])
def test_random_matrices(bits):
    """The graph is that matrix, no deeper than wanted, and shares: it has fewer additions than digits."""
    rng = np.random.default_rng(bits)
    for outputs, inputs in ((1, 1), (3, 16), (8, 5)):
        matrix = rng.integers(-(1 << (bits - 1)), 1 << (bits - 1), (outputs, inputs))
        matrix[rng.random(matrix.shape) < 0.2] = 0
        words = [Range(0, 1023)] * inputs
        depth = least_depth(matrix)
        shallow, deep = adder_graph(matrix, words, depth), adder_graph(matrix, words, depth + 2)
        for graph, most in ((shallow, depth), (deep, depth + 2)):
            assert np.array_equal(graph.matrix, matrix)
            assert graph.depth <= most
        digits = sum(len(canonical_signed_digits(w)) for w in matrix.ravel().tolist())
        assert sum(deep.adder_bits(words)) <= sum(shallow.adder_bits(words))
        assert len(deep.additions) <= max(digits - np.count_nonzero(matrix.any(axis=1)), 0)


@pytest.mark.parametrize(
    "matrix",
    [
        [[0, 0], [0, 0]],
        [[1, 0], [0, -4]],
        [[-1, -1], [1, 1]],
        [[3, 5], [3, 5], [-12, -20]],
        [[7]],
        [[-8]],
        [[131_071]],
    ],
)
def test_zeros_powers_of_two_and_equal_rows(matrix):
    matrix = np.array(matrix)
    graph = adder_graph(matrix, [Range(-3, 0)] * matrix.shape[1], 4)
    assert np.array_equal(graph.matrix, matrix)
    if (matrix[0] == [3, 5][: matrix.shape[1]]).all():
        assert len(graph.additions) == 3


def test_strides_do_not_matter():
    """A transposed and a sliced matrix are read in their order, not in the memory's."""
    matrix = np.arange(1, 25).reshape(4, 6)
    for view in (matrix.T, matrix[::2, ::3], np.asfortranarray(matrix)):
        graph = adder_graph(view, [Range(0, 7)] * view.shape[1], 6)
        assert np.array_equal(graph.matrix, view)


def test_the_same_again():
    matrix = np.random.default_rng(4).integers(-128, 128, (8, 8))
    first = adder_graph(matrix, [Range(0, 127)] * 8, 7)
    adder_solver._search.cache_clear()
    assert adder_graph(matrix, [Range(0, 127)] * 8, 7) == first


def test_an_input_that_is_always_zero():
    matrix = np.array([[3, 11], [0, 7]])
    assert np.array_equal(adder_graph(matrix, [Range(0, 5), Range(0, 0)], 4).matrix, matrix)


def test_too_small_a_depth():
    with pytest.raises(ValueError, match="depth 2: expected at least 3"):
        adder_graph(np.array([[1365]]), [Range(0, 1)], 2)
