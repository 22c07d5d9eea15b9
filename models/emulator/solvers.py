"""The Poisson solvers' tables in float64 by the names of `poisson.solver`.

Each entry is made from the integer solver and has

    frame_axis      axis of the frames in the array that `solve` takes, 0 or 1
    solve(sources)  sources to solutions in place, (frames, N, N) or (N, frames, N)

and raises NotExactError, naming the stage, for integers that float64 would not hold exactly.
"""

from fastac.models.emulator.dst2d import TransformTables
from fastac.models.emulator.tridiagonal import RecurrenceTables
from fastac.store.kinds import Kinds

SOLVERS = Kinds("poisson.solver", {"dst2d": TransformTables, "tridiagonal": RecurrenceTables})
