"""Products of a constant matrix as additions of shifted sums, which several outputs may share."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fastac.models.integer.words import signed_width


@dataclass(frozen=True)
class Operand:
    """A node's value times 2**`shift`, negated if `negative`."""

    node: int
    shift: int = 0
    negative: bool = False


def free_bits(first: Operand, second: Operand) -> int:
    """Low bits of a sum that need no adder: those that one operand alone has, unless it is subtracted."""
    low = first if second.shift else second
    return 0 if low.negative else max(first.shift, second.shift)


@dataclass(frozen=True)
class Range:
    """All integers from `low` to `high`."""

    low: int
    high: int

    @property
    def signed(self) -> bool:
        return self.low < 0

    @property
    def width(self) -> int:
        """Bits of a word that holds the range, with a sign bit only where it has negative numbers."""
        if self.signed:
            return signed_width(max(self.high, -self.low - 1))
        return max(self.high.bit_length(), 1)


@dataclass(frozen=True)
class AdderGraph:
    """A matrix-vector product: nodes 0 to `inputs` − 1 are the inputs, each further one adds two operands.

    additions : (first, second) operands of each further node, which come before it; at most one of the two
        is negative, and at least one has shift 0
    outputs : an operand for each row of the matrix, or None for a row of zeros
    """

    inputs: int
    additions: tuple[tuple[Operand, Operand], ...]
    outputs: tuple[Operand | None, ...]

    @cached_property
    def coefficients(self) -> list[np.ndarray]:
        """Each node as a linear form: its factor for every input, int64 (inputs,)."""
        rows = list(np.eye(self.inputs, dtype=np.int64))
        for first, second in self.additions:
            rows.append(_scaled(rows, first) + _scaled(rows, second))
        return rows

    @property
    def matrix(self) -> np.ndarray:
        """The matrix that the graph multiplies by, int64 (outputs, inputs)."""
        nothing = np.zeros(self.inputs, np.int64)
        return np.array([nothing if o is None else _scaled(self.coefficients, o) for o in self.outputs])

    @cached_property
    def depths(self) -> list[int]:
        """Additions on the longest path to each node."""
        depths = [0] * self.inputs
        for first, second in self.additions:
            depths.append(1 + max(depths[first.node], depths[second.node]))
        return depths

    @property
    def depth(self) -> int:
        """Additions on the longest path to an output."""
        return max((self.depths[o.node] for o in self.outputs if o is not None), default=0)

    def ranges(self, inputs: list[Range]) -> list[Range]:
        """What each node takes for inputs from these ranges; both ends are reached."""
        low, high = (np.array([getattr(x, end) for x in inputs], object) for end in ("low", "high"))
        found = []
        for row in self.coefficients:
            up, down = np.maximum(row, 0).astype(object), np.minimum(row, 0).astype(object)
            found.append(Range(int(up @ low + down @ high), int(up @ high + down @ low)))
        return found

    def adder_bits(self, inputs: list[Range]) -> list[int]:
        """Full adders of each addition; low bits that come from one operand alone take none."""
        widths = [x.width for x in self.ranges(inputs)[self.inputs :]]
        return [width - free_bits(*pair) for width, pair in zip(widths, self.additions, strict=True)]

    def check(self, matrix: np.ndarray) -> None:
        """Raise ValueError unless the graph multiplies by exactly this matrix."""
        if not np.array_equal(self.matrix, matrix):
            raise ValueError(f"adder graph of {len(self.additions)} additions: multiplies by another matrix")


def with_cheapest_signs(graph: AdderGraph) -> AdderGraph:
    """The same products with inner nodes negated where this frees more low bits of subtractions from adders.

    Outputs keep their signs.
    """
    additions = list(graph.additions)
    users: dict[int, list[int]] = {node: [] for node in range(graph.inputs + len(additions))}
    for k, pair in enumerate(additions):
        for node in {operand.node for operand in pair}:
            users[node].append(k)
    fixed = {o.node for o in graph.outputs if o is not None}
    candidates = [k for k in range(len(additions)) if graph.inputs + k not in fixed]
    improved = True
    while improved:
        improved = False
        for k in candidates:
            node = graph.inputs + k
            changed = {k: tuple(_negated(o) for o in additions[k])}
            for user in users[node]:
                pair = changed.get(user, additions[user])
                changed[user] = tuple(_negated(o) if o.node == node else o for o in pair)
            if any(first.negative and second.negative for first, second in changed.values()):
                continue
            if sum(free_bits(*pair) - free_bits(*additions[j]) for j, pair in changed.items()) > 0:
                improved = True
                for j, pair in changed.items():
                    additions[j] = pair
    return replace(graph, additions=tuple(additions))


def _negated(operand: Operand) -> Operand:
    return Operand(operand.node, operand.shift, not operand.negative)


def _scaled(rows: list[np.ndarray], operand: Operand) -> np.ndarray:
    row = rows[operand.node] << operand.shift
    return -row if operand.negative else row


class GraphBuilder:
    """Makes an `AdderGraph` of additions one by one, and a node only once.

    A node is divided by its power of two, and its first factor is positive, so that equal sums with other
    shifts or signs are one node.
    """

    def __init__(self, inputs: int):
        self.inputs = inputs
        self.rows = list(np.eye(inputs, dtype=np.int64))
        self.additions: list[tuple[Operand, Operand]] = []
        self._nodes = {tuple(row.tolist()): node for node, row in enumerate(self.rows)}

    def add(self, first: Operand, second: Operand) -> Operand | None:
        """The sum of two operands; None if it is always 0."""
        least = min(first.shift, second.shift)
        first, second = (Operand(o.node, o.shift - least, o.negative) for o in (first, second))
        row = _scaled(self.rows, first) + _scaled(self.rows, second)
        if not row.any():
            return None
        negative = bool(row[np.flatnonzero(row)[0]] < 0)
        if negative:
            row = -row
            first, second = (_negated(o) for o in (first, second))
        even = int(np.bitwise_or.reduce(row))
        shift = (even & -even).bit_length() - 1
        key = tuple((row >> shift).tolist())
        if key in self._nodes:
            return Operand(self._nodes[key], least + shift, negative)
        # A sum whose low bits are always 0 keeps them: they are rare.
        node = self._nodes[tuple(row.tolist())] = len(self.rows)
        self.rows.append(row)
        self.additions.append((first, second))
        return Operand(node, least, negative)

    def graph(self, outputs: list[Operand | None]) -> AdderGraph:
        """The graph of what the outputs need."""
        needed = {o.node for o in outputs if o is not None}
        for node in range(len(self.rows) - 1, self.inputs - 1, -1):
            if node in needed:
                needed.update(o.node for o in self.additions[node - self.inputs])
        kept = [node for node in range(self.inputs, len(self.rows)) if node in needed]
        number = dict(enumerate(range(self.inputs)))
        number |= {node: self.inputs + k for k, node in enumerate(kept)}

        def moved(o: Operand) -> Operand:
            return Operand(number[o.node], o.shift, o.negative)

        return AdderGraph(
            self.inputs,
            tuple(tuple(map(moved, self.additions[node - self.inputs])) for node in kept),
            tuple(None if o is None else moved(o) for o in outputs),
        )
