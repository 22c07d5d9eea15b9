"""What the Poisson solvers' hardware takes, by the names of `poisson.solver`; energy.py, memories.py and
resources.py add the rest of the design.

Each entry has, `frame` being the sizes (fastac/synth/estimates/work.py) and `solver` the integer solver,

    instances                 by the name of each component between the sine transforms of the rows, the stage
                              that its look-up tables are counted in
    transforms(solver)        its sine transforms
    works(frame, solver)      by stage in order, between the same transforms, a frame's operations
    memories(frame, solver)   (stage, number, bits of a word, words) of those deep enough for block RAM
    features(frame, solver)   by stage, the counts that its look-up tables are fitted to
"""

from fastac.store.kinds import Kinds
from fastac.synth.estimates.dst2d import Dst2dCosts
from fastac.synth.estimates.tridiagonal import TridiagonalCosts

SOLVERS = Kinds("poisson.solver", {"dst2d": Dst2dCosts, "tridiagonal": TridiagonalCosts})
