"""Slopes that drive every word of the Poisson solver to its largest magnitude.

But for rounding, each word is a linear function of the slopes. Slopes of ±limit with the signs of that
function's weights, taken where the weights' L1 norm is largest, therefore reach the word's bound. The weights
follow from the integer tables, see models/integer/bounds.py.
"""

from dataclasses import replace

import numpy as np

from fastac.models.integer.bounds import stencil_norms
from fastac.models.integer.laplacian import STENCILS, divergence_of, transposed_differences
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.integer.sine_transform import SineTransform
from fastac.models.integer.source import PoissonSource
from fastac.models.integer.words import LARGEST_ERROR
from fastac.studies.robustness.worst_case import WorstCase, magnitude

CANDIDATES = 8
"""Pixels searched on either side of the image's middle for the deepest solution: the boundary is farthest
there."""


def _stimulus(pipeline: IntegerPipeline, weight: np.ndarray) -> tuple[PoissonSource, np.ndarray]:
    """The Poisson source and slopes (N + 2, N + 2, 2) that drive a word to its largest magnitude; `weight`
    (N, N) are the word's weights of the source. Where the offset is loadable, it is the worst one."""
    source, limit = pipeline.source, pipeline.ratio.limit
    slopes = (limit * np.sign(transposed_differences(weight, source.divergence))).astype(np.int64)
    if source.offset_limit is not None:
        return replace(source, offset=-divergence_of(slopes, source.divergence)), slopes
    # Both the slopes' share and the offset's count with the same sign.
    return source, slopes if (weight * source.offset).sum() <= 0 else -slopes


def _weights(pipeline: IntegerPipeline) -> dict[str, np.ndarray]:
    """By name of the solver's stages, the weights (N, N) of the source for the stage's largest output word.

    In arbitrary units: only signs and positions are used.
    """
    source, solver, divergence = pipeline.source, pipeline.solver, pipeline.source.divergence
    s = solver.row_forward.matrix.astype(np.float64)
    n = len(s)
    # In units of the source's word; a loadable offset can add as much as the slopes, at each place.
    stencil = STENCILS[divergence]
    limit = pipeline.ratio.limit * stencil.span
    offset = source.offset * float(source.offset_limit is None)
    along, across = stencil_norms(s, divergence)

    def row(mode: int, rows: np.ndarray) -> np.ndarray:
        return np.outer(rows, s[mode])

    def farthest(reach: np.ndarray, constant: np.ndarray) -> tuple[int, int]:
        return np.unravel_index((limit * reach + np.abs(constant)).argmax(), (n, n))

    def through(operators: np.ndarray) -> tuple[int, int]:
        """Mode and row of the largest output of operators (n, i, k): mode n, row k to row i."""
        along_rows = np.stack([stencil_norms(o, divergence)[0] for o in operators])
        norms = np.abs(operators).sum(axis=2) * along[:, None] + along_rows * across[:, None]
        return farthest(norms, np.einsum("nik,kn->ni", operators, offset @ s))

    i, mode = farthest((along + stencil.norm * across)[None, :], offset @ s)
    found = {"row_forward": row(mode, np.eye(n)[i])}
    for name, operators in solver.mode_operators().items():
        mode, i = through(operators)
        found[name] = row(mode, operators[mode, i])
    best = 0.0
    for i in range(max(n // 2 - CANDIDATES, 0), min(n // 2 + CANDIDATES, n)):
        green = (s[:, n // 2, None] * operators[:, i, :]).T @ s  # of the pixel in row i, middle column
        reach = pipeline.ratio.limit * np.abs(transposed_differences(green, divergence)).sum()
        reach += abs((green * offset).sum())
        if reach > best:
            best, found["row_inverse"] = reach, green
    return found


def of_solver(pipeline: IntegerPipeline) -> list[WorstCase]:
    """Worst cases of the source and of the solver's stages: each for a pattern of slopes and its negative."""
    source, solver = pipeline.source, pipeline.solver
    weights = _weights(pipeline)
    note = "any slopes at rest that can be loaded" if source.offset_limit is not None else ""

    # The source: at the pixel with the largest offset.
    single = np.zeros_like(source.offset)
    place = np.unravel_index(np.abs(source.offset).argmax(), single.shape)
    single[place] = 1
    worst, slopes = _stimulus(pipeline, single)
    both = np.stack([slopes, -slopes])
    outputs = worst(both)
    found = [
        WorstCase(
            "source",
            "output",
            source.width,
            source.bound,
            source.bound,
            magnitude(outputs),
            worst,
            both,
            outputs,
            note,
        )
    ]
    apart = "" if note else "the bound adds the slopes' and the offset's largest pixels, which may differ"
    for (name, table), stage in zip(solver.parts.items(), solver.stages, strict=True):
        worst, slopes = _stimulus(pipeline, weights[name])
        steps = solver.steps(worst(np.stack([slopes, -slopes])))
        inputs, outputs = next((given, words) for step, given, words in steps if step == name)
        # Rounded once more; rounding down increases the magnitude of −bound.
        up = LARGEST_ERROR[table.rounding]
        bound = int(np.floor(stage.bound_px * 2.0**stage.format.fraction + up))
        found.append(
            WorstCase(
                name,
                "output",
                stage.format.width,
                bound,
                bound,
                magnitude(outputs),
                table,
                inputs,
                outputs,
                note or (name == "row_inverse") * apart,
            )
        )
        if isinstance(table, SineTransform):
            sums = np.abs(inputs @ table.matrix).max() + table.half_unit
            found.append(
                WorstCase(
                    name,
                    "accumulator",
                    table.accumulator_width,
                    table.accumulator_bound,
                    min(table.accumulator_bound, bound + 1 << table.shift),
                    int(sums),
                    table,
                    inputs,
                    outputs,
                    "the bound is of any input of its width",
                )
            )
    return found
