"""Places for the blocks of a diagram: in layers along the streams, with few crossings and straight ways."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import minimize

SWEEPS = 12
STRAIGHT = 8
"""Weight of a stream's slope between two blocks that have no other there."""
CENTRED = 1e-5
"""Weight of a place's distance from 0 beside that of a stream's slope: the layout stands still."""


@dataclass(frozen=True)
class Layout:
    """Layers from top to bottom, and where everything is.

    layers : names in each layer from left to right; a stream that passes a layer has a place there, too,
        by the name (source, target, layer)
    centre : x of each name, in units of the widths that were given
    ways : {(source, target): names that the stream passes, both ends included}
    """

    layers: list[list]
    centre: dict
    ways: dict[tuple, list]


def ranks(names: Sequence[str], edges: Sequence[tuple[str, str]]) -> dict[str, int]:
    """The layer of each name: one below the lowest of those before it. Raises ValueError for a circle."""
    found: dict[str, int] = {}
    left = list(names)
    while left:
        ready = [name for name in left if all(source in found for source, target in edges if target == name)]
        if not ready:
            raise ValueError(f"streams in a circle: {', '.join(left)}")
        for name in ready:
            before = [found[source] for source, target in edges if target == name]
            found[name] = max(before, default=-1) + 1
        left = [name for name in left if name not in found]
    return found


def place(
    widths: Mapping[str, float], edges: Sequence[tuple[str, str]], *, gap: float, lane: float
) -> Layout:
    """Layers and places for blocks of these widths.

    gap : between two blocks beside each other
    lane : width that a stream takes where it passes a layer
    """
    rank = ranks(list(widths), edges)
    layers: list[list] = [[] for _ in range(max(rank.values()) + 1)]
    for name in widths:
        layers[rank[name]].append(name)
    wide, ways, near = dict(widths), {}, {name: ([], []) for name in widths}
    for source, target in edges:
        between = [(source, target, layer) for layer in range(rank[source] + 1, rank[target])]
        for passed in between:
            layers[passed[2]].append(passed)
            wide[passed], near[passed] = lane, ([], [])
        way = [source, *between, target]
        ways[source, target] = way
        for above, below in pairwise(way):
            near[above][1].append(below)
            near[below][0].append(above)
    _order(layers, near)
    return Layout(layers, _centres(layers, near, wide, gap), ways)


def _order(layers: list[list], near: Mapping) -> None:
    """Sort each layer by the mean place of what it is connected with, above and below in turn."""
    place = {name: float(k) for layer in layers for k, name in enumerate(layer)}
    for sweep in range(SWEEPS):
        side = sweep % 2
        for layer in layers if side == 0 else reversed(layers):
            wanted = {name: np.mean([place[other] for other in near[name][side] or [name]]) for name in layer}
            layer.sort(key=wanted.get)
            place |= {name: float(k) for k, name in enumerate(layer)}


def _centres(layers: list[list], near: Mapping, wide: Mapping, gap: float) -> dict:
    """x of each name: streams as straight as the order and the gaps in each layer let them be."""
    names = [name for layer in layers for name in layer]
    index = {name: k for k, name in enumerate(names)}
    links = [(index[name], index[below]) for name in names for below in near[name][1]]
    beside = [
        (index[one], index[other], (wide[one] + wide[other]) / 2 + gap)
        for layer in layers
        for one, other in pairwise(layer)
    ]
    slopes = np.zeros((len(links), len(names)))
    for row, (above, below) in enumerate(links):
        alone = len(near[names[above]][1]) == 1 and len(near[names[below]][0]) == 1
        weight = STRAIGHT if alone else 1
        slopes[row, above], slopes[row, below] = weight, -weight
    steps = np.zeros((len(beside), len(names)))
    for row, (one, other, _) in enumerate(beside):
        steps[row, one], steps[row, other] = -1, 1
    least = np.array([step for *_, step in beside])
    start = np.zeros(len(names))
    for one, other, step in beside:
        start[other] = start[one] + step
    weights = slopes.T @ slopes + CENTRED * np.eye(len(names))
    found = minimize(
        lambda x: x @ weights @ x,
        start,
        jac=lambda x: 2 * weights @ x,
        method="SLSQP",
        constraints={"type": "ineq", "fun": lambda x: steps @ x - least, "jac": lambda x: steps}
        if beside
        else (),
        options={"maxiter": 500},
    ).x
    left = min(found[index[name]] - wide[name] / 2 for name in names)
    return {name: float(found[index[name]] - left) for name in names}
