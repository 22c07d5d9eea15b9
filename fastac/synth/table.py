"""What synthesis found, as a table and as the report's resources."""

import json
from pathlib import Path

from fastac.synth import place_ecp5, yosys
from fastac.synth.synthesis import COUNT, FILE, LUTS, PLACE, REGISTERS, stated


def resources(folder: Path, hardware: dict) -> dict:
    """What report.json's `resources` say by synthesis; empty unless synth.json is of this very Verilog.

    hardware : the build's verilog/hardware.json
    """
    try:
        content = json.loads((folder / FILE).read_text())
    except (OSError, json.JSONDecodeError):
        return {}
    if any(content.get(key) != hardware.get(key) for key in ("bundle_sha256", "rtlil_sha256")):
        return {}
    totals, modules = content["totals"], content["modules"]
    found = {}
    if "dsp48e2" in totals:
        by_module = {
            name: entry[COUNT.name]["value"]["dsp48e2"] * len(entry["instances"])
            for name, entry in modules.items()
            if entry[COUNT.name]["value"]["dsp48e2"]
        }
        found["dsp48e2"] = totals["dsp48e2"]
        found["dsp48e2_by_module"] = stated(by_module, yosys.COUNT_ORIGIN)
        half, origin = totals["ramb18e2"]["value"] / 2, totals["ramb36e2"]["origin"]
        found["ramb36"] = stated(totals["ramb36e2"]["value"] + half, f"{origin}; two RAMB18E2 are one RAMB36")
        found["uram288"] = totals["uram288"]
        shifts = totals["srl16e"]["value"] + totals["srlc32e"]["value"]
        found["shift_register_luts"] = stated(shifts, totals["srl16e"]["origin"])
    for name in ("lut", "lut_share_percent", "carry8"):
        if name in totals:
            found[name] = totals[name]
    registers = {k: totals[k]["value"] for k in totals if k.startswith("dsp48e1_")}
    if registers:
        found["dsp48e1_registers"] = stated(registers, totals["dsp48e1_dsp"]["origin"])
    placed = {
        name: entry[PLACE.name]["value"]
        for name, entry in modules.items()
        if "clock_mhz" in entry.get(PLACE.name, {}).get("value", {})
    }
    if placed:
        clocks = {name: value["clock_mhz"] for name, value in placed.items()}
        forms = [f"{name}: {value['form']}" for name, value in placed.items() if value["form"] != "as built"]
        limits = "; ".join([place_ecp5.ORIGIN, *forms])
        found["ecp5_clock_mhz_by_module"] = stated(clocks, limits)
        missing = f", {len(modules) - len(clocks)} not placed" if len(clocks) < len(modules) else ""
        slowest = min(clocks, key=clocks.get)
        origin = f"slowest of {len(clocks)} modules{missing}: {slowest}; {limits}"
        found["ecp5_clock_mhz"] = stated(clocks[slowest], origin)
    return found


def _row(name: str, times: int, entry: dict) -> str:
    counted = entry.get(COUNT.name, {}).get("value")
    registers = entry.get(REGISTERS.name, {}).get("value")
    mapped = entry.get(LUTS.name, {}).get("value")
    placed = entry.get(PLACE.name, {}).get("value", {})
    blocks = ("dsp48e2", "ramb36e2", "ramb18e2", "uram288", "srl16e", "srlc32e")
    cells = [f"{counted[b] or '':>8}" if counted else f"{'?':>8}" for b in blocks]
    cells += [f"{mapped[b] or '':>8}" if mapped else f"{'?':>8}" for b in ("lut", "carry8")]
    absorbed = ""
    if registers and registers["dsp"]:
        absorbed = "{a}/{b}/{m}/{p} of {dsp}".format(**registers)
    clock, remarks = "", []
    if "clock_mhz" in placed:
        clock, path = f"{placed['clock_mhz']:.1f}", placed["critical_path"]
        remarks.append(" → ".join([path["from"], *path["through"], path["to"]]))
        remarks += [placed["form"]] if placed["form"] != "as built" else []
    elif "not_placed" in placed:
        remarks.append(f"not placed: {placed['not_placed']}")
    remarks += [f"{task} failed: {error}" for task, error in entry.get("errors", {}).items()]
    return f"{name:32s}{times:>3}{''.join(cells)}  {absorbed:>22s}{clock:>8s}  {'; '.join(remarks)}".rstrip()


def table(content: dict, device: dict) -> str:
    """The result as text; `device` gives the part's name and its totals."""
    blocks = ("DSP48E2", "RAMB36", "RAMB18", "URAM288", "SRL16E", "SRLC32E", "LUT", "CARRY8")
    head = "".join(f"{b:>8s}" for b in blocks)
    lines = [f"{'module':32s}{'n':>3s}{head}  {'A/B/M/P on 7-series':>22s}{'MHz':>8s}  critical path on ECP5"]
    lines += [_row(name, len(e["instances"]), e) for name, e in content["modules"].items()]
    totals = content["totals"]
    if "dsp48e2" in totals:
        instances = sum(len(e["instances"]) for e in content["modules"].values())
        entry = {COUNT.name: {"value": {k: v["value"] for k, v in totals.items()}}}
        if "lut" in totals:
            entry[LUTS.name] = entry[COUNT.name]
        if "dsp48e1_dsp" in totals:
            registers = {k: totals[f"dsp48e1_{k}"]["value"] for k in ("dsp", *yosys.REGISTERS)}
            entry[REGISTERS.name] = {"value": registers}
        lines.append(_row("sum of modules", instances, entry))
    held = {"DSP48E2": device["dsp48e2"], "RAMB36": device["ramb36"], "RAMB18": 2 * device["ramb36"]}
    held |= {"URAM288": device["uram288"], "LUT": device["lut"], "CARRY8": device["carry8"]}
    lines.append(f"{device['part']:35s}" + "".join(f"{held.get(b, ''):>8}" for b in blocks))
    if "lut_share_percent" in totals:
        share = totals["lut_share_percent"]
        lines.append(f"LUT: {share['value']:g}%, {share['origin']}")
    return "\n".join(line.rstrip() for line in lines)
