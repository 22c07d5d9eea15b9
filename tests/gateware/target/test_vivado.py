import pytest

from fastac.gateware.bus.frame_timer import FrameTimer
from fastac.gateware.target.device import DEVICE, DeviceError, check_block_rams, check_multipliers
from fastac.gateware.target.elaboration import to_verilog
from fastac.gateware.target.vivado import XCZU19EGPlatform, write_vivado_project


def component():
    return FrameTimer(force=True, depth=False)


@pytest.mark.parametrize("given", ["component", "Verilog"])
def test_vivado_project(tmp_path, given):
    design = component() if given == "component" else to_verilog(component(), name="fastac")
    files = write_vivado_project(design, tmp_path / "vivado", 250, name="fastac")
    assert all(file.is_file() for file in files)
    texts = {file.name: file.read_text() for file in files}
    tcl = texts["build.tcl"].splitlines()
    part = DEVICE["part"]
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
    plan = XCZU19EGPlatform(300).prepare(
        component(), "fastac", add_constraints="set_false_path -to [get_ports interrupt]"
    )
    assert plan.files["fastac.xdc"].splitlines()[1:] == [
        "create_clock -name clk -period 3.333 [get_ports clk]",
        "set_false_path -to [get_ports interrupt]",
    ]


@pytest.mark.parametrize("clock_mhz", [0, -1, 776])
def test_invalid_clock(clock_mhz):
    with pytest.raises(ValueError, match=f"clock_mhz {clock_mhz}: expected more than 0, at most 775"):
        XCZU19EGPlatform(clock_mhz)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("module other(clk);", "name 'fastac': expected a module of this name"),
        ("module fastac(aclk);", "name 'fastac': expected this module to have a port clk"),
    ],
)
def test_invalid_verilog(tmp_path, text, message):
    with pytest.raises(ValueError, match=message):
        write_vivado_project(text, tmp_path, 250, name="fastac")
    assert not list(tmp_path.iterdir())


def test_too_many_multipliers():
    check_multipliers({"normals": 352, "depth": 1616})
    with pytest.raises(DeviceError) as error:
        check_multipliers({"normals": 352, "depth": 1617})
    assert str(error.value) == (
        "1,969 DSP48E2 (normals 352, depth 1,617): the xczu19eg-ffvc1760-2-i has 1,968; choose fewer"
        " hardware.pixels_per_clock, hardware.weights = 'baked' or a smaller sensor.width_px"
    )


def test_too_many_block_rams():
    check_block_rams({"background": 12.5, "force": 971.5})
    with pytest.raises(DeviceError) as error:
        check_block_rams({"background": 12.5, "force": 1012})
    assert str(error.value) == (
        "1,024.5 RAMB36 (background 12.5, force 1,012): the xczu19eg-ffvc1760-2-i has 984; choose"
        " force.kernel = 'collapsed', a smaller force.kernel_size, fewer numbers.kernel_bits or a smaller"
        " sensor.width_px"
    )
