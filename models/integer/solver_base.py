"""What every integer Poisson solver is: its stages in a row, each with a word that its worst case fits."""

from collections.abc import Callable, Iterator
from dataclasses import fields
from typing import ClassVar, Self

import numpy as np

from fastac.models.integer.bounds import Stage
from fastac.models.integer.words import NEAREST, Fixed


def applied(stage: Callable, words: np.ndarray) -> np.ndarray:
    """A stage's output, by its own function."""
    return stage(words)


class IntegerSolver:
    """Base class of the solvers of models/integer/solvers.py.

    A subclass is a frozen dataclass whose fields are its stages, callables with `size`, `input_width`,
    `output_width` and `rounding`, in the order in which words pass through them, and last `stages`: the
    worst case and the word of each. The first stage, `row_forward`, and the last, `row_inverse`, are sine
    transforms of the rows (SineTransform); those between work on each column mode by itself.
    """

    stages: tuple[Stage, ...]
    transposed_before: ClassVar[frozenset[str]] = frozenset()
    """The stages that take columns where the one before gave rows, or the other way round."""

    @classmethod
    def fitted(
        cls,
        *,
        offset: np.ndarray,
        source: Fixed,
        slope_limit: float,
        divergence: str,
        coefficient_fraction: int,
        data_bits: int,
        rounding: str = NEAREST,
    ) -> Self:
        """The solver whose every word is fitted to its worst case.

        offset : (N, N) integers in the source's unit, as in PoissonSource
        source : format of the right-hand side; slope_limit : the largest |slope| that the slopes' word holds
        rounding : of every stage; a floor's errors are up to a whole unit, and the words hold them

        Raises ValueError where `data_bits` cannot hold a bound.
        """
        raise NotImplementedError

    def mode_operators(self) -> dict[str, np.ndarray]:
        """By the name of each stage between the sine transforms of the rows, in order: the linear map from
        the transformed source to the stage's output, without roundings, (mode n, row i, source row k)."""
        raise NotImplementedError

    @property
    def parts(self) -> dict[str, Callable]:
        """The stages by name, in order."""
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name != "stages"}

    @property
    def depth_format(self) -> Fixed:
        return self.stages[-1].format

    def steps(
        self, source: np.ndarray, apply: Callable[[Callable, np.ndarray], np.ndarray] = applied
    ) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
        """Of each stage, in order: its name, what enters and what leaves it, for sources (..., N, N)."""
        words = source
        for name, stage in self.parts.items():
            given = np.swapaxes(words, -1, -2) if name in self.transposed_before else words
            words = apply(stage, given)
            yield name, given, words

    def __call__(self, source: np.ndarray) -> np.ndarray:
        """Sources (..., N, N), integers, to solutions (..., N, N) in words of `depth_format`."""
        solution = source
        for _, _, words in self.steps(source):
            solution = words
        return solution
