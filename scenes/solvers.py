"""What the scene must know of each Poisson solver: the table of the names that `poisson.solver` may have.

A solver's arithmetic and hardware stand behind the same name in models/integer/solvers.py,
models/emulator/solvers.py, gateware/poisson/solvers.py and fastac/synth/estimates/solvers.py;
docs/extending.md tells how to add one.
"""

from dataclasses import dataclass

from fastac.store.kinds import Kinds


@dataclass(frozen=True)
class SolverFacts:
    """What follows from the choice of a solver.

    finds_depth : whether it solves for depth; where not, the force is a weighted sum of the slopes
    can_clamp : whether displacement away from the camera may count as zero on the way to the force
    square_images : whether depth, or force weights that follow from it, need images as high as wide
    least_row_beats : beats that a row of inner pixels takes at least
    """

    finds_depth: bool = True
    can_clamp: bool = True
    square_images: bool = True
    least_row_beats: int = 1


DST2D = SolverFacts()
TRIDIAGONAL = SolverFacts(least_row_beats=5)  # each row needs the one before it, which takes 5 clocks
ADJOINT = SolverFacts(finds_depth=False, can_clamp=False)
SOLVERS = Kinds("poisson.solver", {"dst2d": DST2D, "tridiagonal": TRIDIAGONAL, "adjoint": ADJOINT})
