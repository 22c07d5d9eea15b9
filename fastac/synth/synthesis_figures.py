"""The figures that synthesis adds to the resources of a build's report."""

import json
from pathlib import Path
from typing import Annotated

from pydantic import Field, TypeAdapter, ValidationError
from typing_extensions import TypedDict

from fastac.store.files import DamagedFileError
from fastac.synth import place_ecp5, yosys
from fastac.synth.synthesis import COUNT, FILE, PLACE, stated


class _Total(TypedDict):
    value: Annotated[float, Field(ge=0, le=1e12)]
    origin: str


class _Content(TypedDict):
    """What of synth.json is used without looking at it."""

    totals: dict[str, _Total]
    modules: dict[str, dict[str, object]]


_CONTENT = TypeAdapter(_Content)


def resources(folder: Path, hardware: dict) -> dict:
    """The report's `resources` as synthesis found them; empty unless synth.json belongs to this very Verilog.

    hardware : the build's verilog/hardware.json
    """
    path = folder / FILE
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    keys = ("bundle_sha256", "rtlil_sha256")
    if not isinstance(content, dict) or any(content.get(key) != hardware.get(key) for key in keys):
        return {}
    try:
        _CONTENT.validate_python(content)
        return _figures(content)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(map(str, first["loc"]))
        raise DamagedFileError(f"{path}: {key}: {first['msg']}") from None
    except (KeyError, TypeError, AttributeError) as error:
        raise DamagedFileError(f"{path}: damaged: {error!r}") from None


def _figures(content: dict) -> dict:
    totals, modules = content["totals"], content["modules"]
    found = {}
    for target in yosys.TARGETS.values():
        dsp, whole, half = (name.lower() for name in target.blocks[:3])
        if dsp not in totals:
            continue
        by_module = {
            name: entry[COUNT.name]["value"][dsp] * len(entry["instances"])
            for name, entry in modules.items()
            if entry[COUNT.name]["value"][dsp]
        }
        found[dsp] = totals[dsp]
        origin = yosys.COUNT_ORIGIN.format(options=target.options)
        found[f"{dsp}_by_module"] = stated(by_module, origin)
        number, origin = totals[whole]["value"] + totals[half]["value"] / 2, totals[whole]["origin"]
        found["ramb36"] = stated(number, f"{origin}; two {half.upper()} are one RAMB36")
        if "uram288" in totals:
            found["uram288"] = totals["uram288"]
        shifts = totals["srl16e"]["value"] + totals["srlc32e"]["value"]
        found["shift_register_luts"] = stated(shifts, totals["srl16e"]["origin"])
    for name in ("lut", "lut_share_percent", "carry8", "carry4"):
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
        forms += [
            f"{name}: the lowest of {len(value['clocks_mhz'])} placements"
            for name, value in placed.items()
            if "clocks_mhz" in value
        ]
        limits = "; ".join([place_ecp5.ORIGIN, *forms])
        found["ecp5_clock_mhz_by_module"] = stated(clocks, limits)
        missing = f", {len(modules) - len(clocks)} not placed" if len(clocks) < len(modules) else ""
        slowest = min(clocks, key=clocks.get)
        origin = f"slowest of {len(clocks)} modules{missing}: {slowest}; {limits}"
        found["ecp5_clock_mhz"] = stated(clocks[slowest], origin)
    return found
