"""Upper bounds of a design's counters, which hold in every state that it can reach."""

from collections.abc import Mapping

import z3

WIDEST = 8
"""Widest register, in bits, whose bound is looked for: counters, not data."""
SOLVER_TIMEOUT_MS = 2000


def upper_bounds(smt2: str, module: str, registers: Mapping[str, tuple[int, int]]) -> dict[str, int]:
    """The largest value of each register that is not the largest of its width; others are left out.

    smt2 : the design cut at its registers, as Yosys' `write_smt2` writes it, with inputs NAME.q and outputs
        NAME.d for each register
    registers : {name: (bits, initial value)}

    A bound is raised until no step leads beyond it from any value below it, whatever all other registers and
    the inputs are. So it may be larger than what is ever reached, and never smaller.
    """
    counters = {name: (bits, init) for name, (bits, init) in registers.items() if 1 < bits <= WIDEST}
    links = [f"(declare-fun state () |{module}_s|)"]
    for name, (bits, _) in counters.items():
        for end in ("q", "d"):
            links.append(f"(declare-fun |{name}.{end}| () (_ BitVec {bits}))")
            links.append(f"(assert (= |{name}.{end}| (|{module}_n {name}.{end}| state)))")
    context = z3.Context()  # z3's own one is not for several threads
    solver = z3.Solver(ctx=context)
    solver.set("timeout", SOLVER_TIMEOUT_MS)
    solver.add(z3.parse_smt2_string(smt2 + "\n".join(links), ctx=context))
    found = {}
    for name, (bits, init) in counters.items():
        now, then = (z3.BitVec(f"{name}.{end}", bits, context) for end in ("q", "d"))
        bound = _bound(solver, now, then, init)
        if bound < (1 << bits) - 1:
            found[name] = bound
    return found


def _bound(solver: z3.Solver, now, then, bound: int) -> int:
    """The least bound from `bound` on that a step from below it does not leave."""
    while bound < (1 << now.size()) - 1:
        result = solver.check(z3.ULE(now, bound), z3.UGT(then, bound))
        if result == z3.unsat:
            return bound
        if result == z3.unknown:
            break
        bound = solver.model().eval(then, model_completion=True).as_long()
    return (1 << now.size()) - 1
