"""The Poisson solvers' tables in float64 by the names of `poisson.solver`.

Each entry is made from the integer solver and has

    sine       the FoldedSine of the source's rows: where modes are, and how many tasks they are
    tables     what `emulate` takes as its tables
    emulate    the compiled stages of a frame, as tasks of a team (`loops/tasks.py`):
               emulate(board, member, bell, k, before, source, tables, modes, behind), where k is the frame's
               number, `modes` is the sine's memory, and `before`, `source` and `behind` are what
               `stages.find_slopes`, `loops.poisson.transform_source` and `stages.find_depth` take

and raises NotExactError, naming the stage, for integers that float64 would not hold exactly.
"""

from fastac.models.emulator.dst2d import TransformTables
from fastac.models.emulator.tridiagonal import RecurrenceTables
from fastac.store.kinds import Kinds

SOLVERS = Kinds("poisson.solver", {"dst2d": TransformTables, "tridiagonal": RecurrenceTables})
"""The Poisson solver of a sine transform and recurrences over the rows, in float64."""
