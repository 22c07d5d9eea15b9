"""Table of the Poisson solvers' hardware, by the values of `poisson.solver`.

An entry is a component that is constructed from a PoissonSource and the integer solver's stages in order, and
the keywords `height`, `width`, `lanes`, `fold` (clocks between two beats at full rate; with several lanes 1),
`loadable` and `dsp` (the part's DSP slice). It has

    i, o, offset        streams of slopes and solutions, and the write port of the source's offsets
    source              its first stage, a PoissonSourceStream
    last_row_first      whether it outputs the last row of a frame first
    interval, latency   clocks between frames, and from a frame's first slopes to its first solutions
    stages              {stage: clocks that it adds to a frame's latency}
    multipliers         number of DSP slices
    stages_of(width, lanes, divergence, fold=)
                        the stages by formula, without tables, for gateware/cycle_model.py
    multipliers_of(size, lanes, fold=, source_width=, data_bits=, coefficient_width=, dsp=)
                        what the multipliers are at most, from the widths of the words alone, for the same
    engines             {class of an integer stage: its component, constructed from the stage, `lanes`, `fold`
                        and `dsp`}
"""

from fastac.gateware.poisson.dst2d import PoissonSolver
from fastac.gateware.poisson.tridiagonal import TridiagonalPoissonSolver
from fastac.store.kinds import Kinds

SOLVERS = Kinds("poisson.solver", {"dst2d": PoissonSolver, "tridiagonal": TridiagonalPoissonSolver})
