"""The Poisson solvers' integers by the names of `poisson.solver`; what finds no depth has none."""

from fastac.models.integer.dst2d import Solver
from fastac.models.integer.tridiagonal import TridiagonalSolver
from fastac.store.kinds import Kinds

SOLVERS = Kinds("poisson.solver", {"dst2d": Solver, "tridiagonal": TridiagonalSolver})
"""Subclasses of `IntegerSolver`."""
