"""What the scene must know of each way to fit the force model: the names that `force.fit` may have.

The fits themselves are in fastac/flow/force_fits.py, under the same names.
"""

from dataclasses import dataclass

from fastac.store.kinds import Kinds


@dataclass(frozen=True)
class FitFacts:
    """What follows from the choice of a fit.

    of_slopes : whether weights of the slopes are fitted, which needs a solver without depth, and with which
        forces alone can train the pixel network
    of_weights : whether one weight a pixel of the displacement is fitted, which collapsed kernels alone take
    of_kernels : whether the paper's kernels on the displacement are fitted
    """

    of_slopes: bool = False
    of_weights: bool = False
    of_kernels: bool = False


DISPLACEMENT = FitFacts(of_kernels=True)
SLOPES = FitFacts(of_slopes=True)
WEIGHTS = FitFacts(of_weights=True)
FITS = Kinds(
    "force.fit",
    {"displacement": DISPLACEMENT, "weights": WEIGHTS, "polynomials": WEIGHTS, "slopes": SLOPES},
)
