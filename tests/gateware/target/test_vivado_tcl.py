"""The scripts for Vivado in a real Tcl interpreter: options held against the manual, the design complete."""

import pytest
import tcl_runner
from packet_hardware import output, packet_hardware, verilog
from vivado_model import Vivado

from fastac.gateware.target.block_design import block_design
from fastac.gateware.target.boards import choose_board
from fastac.gateware.target.vivado_folder import write_vivado_folder

pytestmark = pytest.mark.skipif(
    tcl_runner.interpreter() is None, reason="no Tcl interpreter: neither tclsh (Debian's tcl) nor tkinter"
)
K26, ZYNQ7 = "xck26-sfvc784-2LV-c", "xc7z020clg400-1"


def hardware_of(kind: str) -> dict:
    if kind == "records":
        return packet_hardware(part=ZYNQ7, side=16)
    if kind == "k26":
        normals, depth = output("normals", 128, 128, 4, 4), output("depth", 126, 126, 1, 4)
        return packet_hardware(normals, depth, part=K26, lanes=4)
    return packet_hardware(output("depth", 126, 126, 1, 1))


@pytest.fixture
def build(tmp_path):
    """Write the folder of a hardware, run a script in it; returns (exit status, what it printed, model)."""

    def run(kind: str, *arguments: str, script="build.tcl", prepare=None, saif=None, **model):
        hardware = hardware_of(kind)
        folder = tmp_path / "vivado"
        folder.mkdir()
        board = choose_board(hardware["part"], None)
        write_vivado_folder(verilog(hardware), hardware, folder, board=board, saif=saif)
        if prepare:
            prepare(folder)
        vivado = Vivado(folder, **model)
        path = folder / script
        status, printed = tcl_runner.run(path, arguments, vivado.names(), vivado.answer, path.parent)
        return status, printed, vivado

    return run


@pytest.mark.parametrize("kind", ["bare", "k26", "records"])
def test_from_the_folder_to_a_bitstream(build, kind):
    status, printed, vivado = build(kind)
    assert status == 0, printed
    design = block_design(hardware_of(kind))
    assert vivado.part == design.part
    assert vivado.validated
    # Every register range at its address, every DMA on the memory, interrupts in order.
    spaces = {segment: offset for (_, segment), (offset, _) in vivado.addresses.items()}
    assert spaces["fastac_0/s_axil/Reg"] == design.core_address
    for dma in design.dmas:
        assert spaces[f"{dma.instance}/S_AXI_LITE/Reg"] == dma.address
        parameters = vivado.cells[dma.instance].parameters
        assert parameters["c_include_sg"] == "0"
        assert 1 << int(parameters["c_sg_length_width"]) > max(c.packet_bytes for c in dma.channels)
        assert (f"fastac_0/{dma.s2mm.port}", f"{dma.instance}/S_AXIS_S2MM") in vivado.links
    lines = {vivado.nets[f"interrupts_0/In{i.line}"]: i for i in design.interrupts}
    assert lines == {f"{i.instance}/{i.pin}": i for i in design.interrupts}
    written = {path.name for path in (vivado.folder / "output").iterdir()}
    assert written >= {"fastac.bit", "fastac.bin", "fastac.hwh", "fastac.xsa", "fastac.bif"}
    arch = "zynq" if kind == "records" else "zynqmp"
    (bootgen,) = vivado.called("exec")
    assert bootgen[1:7] == ["bootgen", "-arch", arch, "-image", "fastac.bif", "-process_bitstream"]
    assert vivado.launched == [("synth_1", ""), ("impl_1", "route_design"), ("impl_1", "write_bitstream")]


def test_the_newest_files_of_the_parts_first_board(build):
    status, printed, vivado = build("k26", "--to", "design")
    assert status == 0, printed
    assert vivado.properties["project", "BOARD_PART"] == "xilinx.com:kv260_som:part0:1.4"
    (preset,) = vivado.called("apply_bd_automation")
    assert "apply_board_preset 1" in preset
    assert vivado.launched == []


@pytest.mark.parametrize(
    ("kind", "arguments", "message"),
    [
        ("k26", ("--board", "zcu104"), "board zcu104: expected, with the part"),
        ("k26", ("--board", "k26"), "board k26: Vivado has no board files xilinx.com:k26c:part0:*: install"),
        (
            "k26",
            ("--board", "kr260"),
            "board kr260: its part is xck26-sfvc784-2LVI-i, the hardware was made for",
        ),
        ("bare", ("--to", "moon"), "option --to moon: expected design, synthesis, implementation, bitstream"),
        ("bare", ("--jobs",), "option --jobs : expected --board, --jobs, --to, each with a value"),
        ("bare", ("--job", "3"), "option --job 3: expected --board, --jobs, --to"),
    ],
)
def test_options_are_checked(build, kind, arguments, message):
    status, printed, vivado = build(kind, *arguments)
    assert status == 1
    assert f"fastac: {message}" in printed
    assert vivado.launched == []


def test_no_boards_files(build):
    status, printed, vivado = build("k26", "--board", "none", "--to", "design")
    assert status == 0, printed
    assert ("project", "BOARD_PART") not in vivado.properties
    assert "apply_board_preset 0" in vivado.called("apply_bd_automation")[0]


def test_own_settings_of_the_processing_system(build):
    def prepare(folder):
        (folder / "processing_system.tcl").write_text(
            "set_property -dict [list CONFIG.PSU__CRF_APB__DDR_CTRL__FREQMHZ 1066"
            " CONFIG.PSU__USE__M_AXI_GP1 1 CONFIG.PSU__CRL_APB__PL0_REF_CTRL__FREQMHZ 50] $ps\n"
        )

    status, printed, vivado = build("bare", "--to", "design", prepare=prepare)
    assert status == 0, printed
    parameters = vivado.cells["ps_0"].parameters
    assert parameters["PSU__CRF_APB__DDR_CTRL__FREQMHZ"] == "1066"
    # A preset's ports and clocks give way to those of the design.
    assert parameters["PSU__USE__M_AXI_GP1"] == "0"
    assert parameters["PSU__CRL_APB__PL0_REF_CTRL__FREQMHZ"] == "150"


@pytest.mark.parametrize(
    ("model", "message"),
    [
        ({"slack": {"max": -0.001}}, "setup slack -0.001 ns is negative"),
        ({"slack": {"min": -0.05}}, "hold slack -0.050 ns is negative"),
        ({"routed": False}, "the design is not PLACED_FULLY"),
        ({"clock_mhz": 100.0}, "the core's clock is 100.000 MHz: expected the scene's 150.000"),
        ({"status": {"synth_1": "synth_design ERROR"}}, "synth_1: synth_design ERROR: see project"),
        ({"status": {"impl_1": "place_design ERROR"}}, "impl_1: place_design ERROR: see project"),
    ],
)
def test_what_fails_leaves_no_bitstream(build, model, message):
    status, printed, vivado = build("bare", **model)
    assert status == 1
    assert f"fastac: {message}" in printed
    assert ("impl_1", "write_bitstream") not in vivado.launched
    assert not list((vivado.folder / "output").glob("fastac.*"))


def test_power_is_estimated_with_the_activity(build, tmp_path):
    saif = tmp_path / "some.saif"
    saif.write_text("(SAIFILE)")
    status, printed, vivado = build("bare", saif=saif)
    assert status == 0, printed
    names = [words[0] for words in vivado.calls]
    assert names.index("read_saif") < names.index("report_power")
    (read,) = vivado.called("read_saif")
    assert read[1:3] == ["-strip_path", "fastac"]
    assert [words[1:] for words in vivado.called("current_instance")] == [["system_i/fastac_0/inst"], []]


def test_the_model_refuses_an_incomplete_design(build):
    """Each line left out of the script must be missed: else the checks above prove nothing."""
    from fastac.gateware.target import vivado_scripts

    source = (vivado_scripts.TCL / "block_design.tcl").read_text()
    cases = {
        "    connect_bd_net $clock [get_bd_pins $settings(instance)/clk]\n": "fastac_0/clk: not connected",
        "    connect_interfaces control_0/M00_AXI $settings(instance)/s_axil\n": "fastac_0/s_axil: not conn",
        "        CONFIG.PSU__USE__M_AXI_GP1 0 \\\n": "ps_0/maxihpm1_fpd_aclk: not connected",
        "            CONFIG.c_include_sg 0 \\\n": "axi_dma_0/m_axi_sg_aclk: not connected",
    }
    text = source
    for line in cases:
        assert source.count(line) == 1, line
        text = text.replace(line, "")
    text = text.replace("peripheral_reset]", "peripheral_aresetn]")

    def leave_out(folder):
        (folder / "block_design.tcl").write_text(text)

    status, printed, vivado = build("bare", prepare=leave_out)
    assert status == 1
    for message in (*cases.values(), "fastac_0/rst: active high, driven by reset_0/peripheral_aresetn"):
        assert message in printed
    assert not vivado.validated


def test_unknown_options_and_parameters_are_refused(build):
    def misspell(folder):
        text = (folder / "block_design.tcl").read_text()
        (folder / "block_design.tcl").write_text(text.replace("-target_address_space", "-address_space"))

    status, printed, _ = build("bare", prepare=misspell)
    assert status == 1
    assert "fastac: assign_bd_address: unknown option -address_space" in printed


def test_the_core_out_of_context(build):
    status, printed, vivado = build("bare", script="core/build.tcl")
    assert status == 0, printed
    assert ["set_property", "HD.CLK_SRC", "BUFGCE_X0Y2", "clk"] in vivado.calls
    names = [words[0] for words in vivado.calls]
    assert names.index("set_property") < names.index("place_design") < names.index("write_checkpoint")
    (design,) = vivado.called("synth_design")
    assert design[1:3] == ["-top", "fastac_01234567"]


@pytest.mark.parametrize(
    ("model", "message"),
    [
        ({"slack": {"min": -0.01}}, "hold slack -0.010 ns"),
        ({"routed": False}, "the design is not PLACED_FULLY"),
    ],
)
def test_the_core_out_of_context_fails(build, model, message):
    status, printed, _ = build("bare", script="core/build.tcl", **model)
    assert status == 1
    assert message in printed


def test_constraints_of_the_core(build):
    status, printed, vivado = build("bare", script="core/fastac_01234567.xdc")
    assert status == 0, printed
    assert vivado.calls[0] == ["get_ports", "clk"]
    assert ["create_clock", "-name", "clk", "-period", "6.667", "clk"] in vivado.calls
    limits = vivado.called("set_max_delay")
    assert [words[1:3] + words[-1:] for words in limits] == [["-datapath_only", "-from", "4.667"]] * 2
