"""The table that `fastac synth` prints: what each module needs and the clock that it reached."""

from fastac.gateware.target.device import Device
from fastac.report.tables import text_table
from fastac.synth import yosys
from fastac.synth.synthesis import COUNT, LUTS, PLACE, REGISTERS

LAST = ("A/B/M/P on 7-series", "MHz", "critical path on ECP5")
"""Columns that are the same for every device."""


def _row(name: str, times: int, entry: dict, target: yosys.Target) -> list:
    """The cells of one module; what was not counted is "?"."""
    counted = entry.get(COUNT.name, {}).get("value")
    registers = entry.get(REGISTERS.name, {}).get("value")
    mapped = entry.get(LUTS.name, {}).get("value")
    placed = entry.get(PLACE.name, {}).get("value", {})
    cells = [counted[block.lower()] or "" if counted else "?" for block in target.blocks]
    cells += [mapped[name] or "" if mapped else "?" for name in ("lut", target.carry)]
    absorbed = ""
    if registers and registers["dsp"]:
        absorbed = "{a}/{b}/{m}/{p} of {dsp}".format(**registers)
    clock, remarks = "", []
    if "clock_mhz" in placed:
        clock, path = f"{placed['clock_mhz']:.1f}", placed["critical_path"]
        remarks.append(" → ".join([path["from"], *path["through"], path["to"]]))
        remarks += [placed["form"]] if placed["form"] != "as built" else []
        if "clocks_mhz" in placed:
            remarks.append("placed at " + ", ".join(f"{mhz:.1f}" for mhz in placed["clocks_mhz"]) + " MHz")
    elif "not_placed" in placed:
        remarks.append(f"not placed: {placed['not_placed']}")
    remarks += [f"{task} failed: {error}" for task, error in entry.get("errors", {}).items()]
    return [name, times, *cells, absorbed, clock, "; ".join(remarks)]


def table(content: dict, device: Device) -> str:
    """The content of synth.json as text, as it was counted for `device`.

    A row for each module, one for their sum and one for the device. The column A/B/M/P counts the registers
    that DSP slices have absorbed at those places.
    """
    target = yosys.TARGETS[device.dsp.name]
    rows = [_row(name, len(entry["instances"]), entry, target) for name, entry in content["modules"].items()]
    totals = content["totals"]
    if device.dsp_key in totals:
        instances = sum(len(entry["instances"]) for entry in content["modules"].values())
        entry = {COUNT.name: {"value": {name: total["value"] for name, total in totals.items()}}}
        if "lut" in totals:
            entry[LUTS.name] = entry[COUNT.name]
        if "dsp48e1_dsp" in totals:
            registers = {name: totals[f"dsp48e1_{name}"]["value"] for name in ("dsp", *yosys.REGISTERS)}
            entry[REGISTERS.name] = {"value": registers}
        rows.append(_row("sum of modules", instances, entry, target))
    held = {name.upper(): number for name, number in device.totals.items()}
    held["RAMB18"] = 2 * device.ramb36
    blocks = (name[:-2] if name.startswith("RAMB") else name for name in target.blocks)
    head = ("module", "n", *blocks, "LUT", target.carry.upper(), *LAST)
    rows.append([device.part, *(held.get(name, "") for name in head[1:])])
    lines = [text_table(head, rows)]
    if "lut_share_percent" in totals:
        share = totals["lut_share_percent"]
        lines.append(f"LUT: {share['value']:g}%, {share['origin']}")
    return "\n".join(lines)
