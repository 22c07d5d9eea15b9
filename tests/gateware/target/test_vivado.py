import pytest

from fastac.gateware.bus.frame_timer import FrameTimer
from fastac.gateware.target.elaboration import to_verilog
from fastac.gateware.target.vivado import PartPlatform, write_vivado_project
from fastac.scenes.parts import DEFAULT_PART, PARTS


def component():
    return FrameTimer(force=True, depth=False)


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("given", ["component", "Verilog"])
def test_vivado_project(tmp_path, given, part):
    design = component() if given == "component" else to_verilog(component(), name="fastac")
    files = write_vivado_project(design, tmp_path / "vivado", 250, part=part, name="fastac")
    assert all(file.is_file() for file in files)
    texts = {file.name: file.read_text() for file in files}
    tcl = texts["build.tcl"].splitlines()
    assert f"create_project -in_memory -part {part}" in tcl
    assert "read_verilog fastac.v" in tcl
    assert "read_xdc -mode out_of_context fastac.xdc" in tcl
    assert f"synth_design -top fastac -part {part} -mode out_of_context" in tcl
    assert "create_clock -name clk -period 4.000 [get_ports clk]" in texts["fastac.xdc"].splitlines()
    assert "LOC" not in texts["fastac.xdc"]
    assert "-source build.tcl" in texts["build_fastac.sh"]
    # The ports are the component's, clock and reset; there are no I/O buffers.
    assert "module fastac(" in texts["fastac.v"]
    for port in ("input clk", "input rst", "input result_valid", "output [31:0] first_to_force"):
        assert port in texts["fastac.v"]
    assert "IBUF" not in texts["fastac.v"]


def test_further_constraints_go_to_the_xdc():
    plan = PartPlatform(300, part=DEFAULT_PART).prepare(
        component(), "fastac", add_constraints="set_false_path -to [get_ports interrupt]"
    )
    assert plan.files["fastac.xdc"].splitlines()[1:] == [
        "create_clock -name clk -period 3.333 [get_ports clk]",
        "set inputs [get_ports -filter {DIRECTION == IN && NAME != clk}]",
        "set_max_delay -datapath_only -from $inputs 2.333",
        "set_max_delay -datapath_only -from [get_clocks clk] -to [all_outputs] 2.333",
        "set_false_path -to [get_ports interrupt]",
    ]


@pytest.mark.parametrize(
    ("part", "clock_mhz", "largest"),
    [
        (DEFAULT_PART, 0, 738),
        (DEFAULT_PART, -1, 738),
        (DEFAULT_PART, 739, 738),
        ("xc7z020clg400-1", 389, 388.2),
    ],
)
def test_invalid_clock(part, clock_mhz, largest):
    with pytest.raises(ValueError, match=f"clock_mhz {clock_mhz}: expected more than 0, at most {largest}$"):
        PartPlatform(clock_mhz, part=part)


@pytest.mark.parametrize(
    ("part", "device", "package", "speed", "family"),
    [
        ("xczu19eg-ffvc1760-2-i", "xczu19eg", "ffvc1760", "2-i", "ultrascaleplus"),
        ("xck26-sfvc784-2LV-c", "xck26", "sfvc784", "2LV-c", "ultrascaleplus"),
        ("xczu7ev-ffvc1156-2-e", "xczu7ev", "ffvc1156", "2-e", "ultrascaleplus"),
        ("xc7z020clg400-1", "xc7z020", "clg400", "1", "series7"),
    ],
)
def test_part_taken_apart(part, device, package, speed, family):
    """As Amaranth puts it together again."""
    platform = PartPlatform(100, part=part)
    assert (platform.device, platform.package, platform.speed) == (device, package, speed)
    assert (platform.family, platform._part) == (family, part)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("module other(clk);", "name 'fastac': expected a module of this name"),
        ("module fastac(aclk);", "name 'fastac': expected this module to have a port clk"),
    ],
)
def test_invalid_verilog(tmp_path, text, message):
    with pytest.raises(ValueError, match=message):
        write_vivado_project(text, tmp_path, 250, part=DEFAULT_PART, name="fastac")
    assert not list(tmp_path.iterdir())
