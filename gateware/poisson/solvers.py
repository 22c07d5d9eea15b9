"""The Poisson solvers' hardware by the names of `poisson.solver`.

Each entry is a component that is made from a PoissonSource and the integer solver's stages in their order,
with `height`, `width`, `lanes` and `loadable`; it has

    i, o, offset        streams of slopes and solutions, and the write port of the source's offsets
    source              the PoissonSourceStream that it begins with
    last_row_first      whether the rows of solutions come last to first
    interval, latency   clocks between frames, and from the first slopes to the first solutions
    stages              by name, what each stage adds to a frame's way, in clocks
    multipliers         products a clock
    stages_of(width, lanes, divergence), multipliers_of(size, lanes)
                        the same by formula, without tables, for gateware/cycle_model.py
    engines             the component of each class of its stages, made from a stage and `lanes`
"""

from fastac.gateware.poisson.dst2d import PoissonSolver
from fastac.gateware.poisson.tridiagonal import TridiagonalPoissonSolver
from fastac.store.kinds import Kinds

SOLVERS = Kinds("poisson.solver", {"dst2d": PoissonSolver, "tridiagonal": TridiagonalPoissonSolver})
