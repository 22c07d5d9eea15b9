"""The Poisson solvers' tables in float64 by the names of `poisson.solver`.

Each entry is made from the integer solver and has

    sine       the FoldedSine of the source's rows: where modes are, and how many tasks they are
    tables     what `solve` takes as its tables
    solve      the compiled stages from slopes to depth, as tasks of a team (`loops/tasks.py`):
               solve(board, member, bell, k, source, tables, modes, behind), where k is the frame's number,
               `source` what `loops.poisson.transform_source` takes first, and `behind` what
               `stages.find_depth` takes last

and raises NotExactError, naming the stage, for integers that float64 would not hold exactly.
"""

from fastac.models.emulator.dst2d import TransformTables
from fastac.models.emulator.tridiagonal import RecurrenceTables
from fastac.store.kinds import Kinds

SOLVERS = Kinds("poisson.solver", {"dst2d": TransformTables, "tridiagonal": RecurrenceTables})
"""The Poisson solver of a sine transform and recurrences over the rows, in float64."""
