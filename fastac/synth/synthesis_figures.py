"""The figures that synthesis adds to the resources of a build's report."""

import json
from pathlib import Path

from fastac.synth import place_ecp5, yosys
from fastac.synth.synthesis import COUNT, FILE, PLACE, stated


def resources(folder: Path, hardware: dict) -> dict:
    """The report's `resources` as synthesis found them; empty unless synth.json belongs to this very Verilog.

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
