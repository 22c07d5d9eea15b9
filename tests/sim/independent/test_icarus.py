import re
from dataclasses import replace

import pytest

from fastac.gateware.bus.register_map import ID
from fastac.sim.independent import icarus
from fastac.sim.independent.outcome import SimulatorError

WITHDRAWN = """
  reg flicker = 0;
  wire offered;
  always @(posedge clk) flicker <= ~flicker;
  assign m_axis_normals_tvalid = offered & (m_axis_normals_tready | flicker);
"""
"""An offer that comes and goes while nobody takes it."""
UNKNOWN = """
  reg [31:0] seen;
  wire [31:0] known;
  always @(posedge clk) if (s_axil_rvalid) seen <= 32'hffffffff;
  assign s_axil_rdata = known & seen;
"""
"""A register without initial value and reset, between the registers and the bus."""
NO_INTERRUPT = """
  assign interrupt = 1'h0;
"""


def changed(text, port, signal, addition):
    """The Verilog with a submodule's `port` of the top module connected to `signal`, and `addition` there."""
    pattern = rf"(\.{port}\()\w+\)"
    text, count = re.subn(pattern, rf"\g<1>{signal})", text, count=1)
    assert count == 1
    place = text.index("\n", text.index(");", text.index("module fastac(")))
    return text[:place] + addition + text[place:]


def run(design, folder, text=None, **settings):
    return icarus.simulate([design.source(folder, text)], "fastac", design.write(folder, **settings), folder)


@pytest.mark.parametrize("name", ["slopes_design", "depth_design"])
@pytest.mark.quick("depth_design")
def test_every_beat_and_register_is_as_the_integers_say(name, icarus_verilog, tmp_path, request):
    design = request.getfixturevalue(name)
    found = run(design, tmp_path)
    assert found.clean, found.first
    assert found.first_pixel_to_result == design.latency
    assert found.frames == len(found.starts) == len(found.results) == 4
    assert found.registers == 4 * (3 + 2 * len(design.bundle.scene.force_axes)) + 2 + 9
    assert min(found.values, found.markers) > 0
    assert found.idle_unknown == 0


def test_what_the_camera_does_not_offer_reaches_no_offered_output(slopes_design, icarus_verilog, tmp_path):
    found = run(slopes_design, tmp_path, unknown_idle=True)
    assert found.clean, found.first


def test_a_changed_operator_is_found(slopes_design, icarus_verilog, tmp_path):
    sums = [place.start() for place in re.finditer(r" \+ \$signed\(axis_0_sum", slopes_design.verilog)]
    text = slopes_design.verilog
    found = run(slopes_design, tmp_path, text[: sums[0]] + " -" + text[sums[0] + 2 :])
    assert found.differences >= 4  # a force in each frame
    assert found.first.startswith("register 5")  # FORCE_X_LOW


def test_a_register_that_starts_unknown_is_found(slopes_design, icarus_verilog, tmp_path):
    text = changed(slopes_design.verilog, "axil__rdata", "known", UNKNOWN)
    found = run(slopes_design, tmp_path, text)
    # What is read first, ID, is offered with its ones unknown, for one clock.
    assert found.unknown == ID.bit_count()
    assert "is unknown in clock" in found.first
    assert found.violations == 1


def test_a_withdrawn_offer_is_found(slopes_design, icarus_verilog, tmp_path):
    text = changed(slopes_design.verilog, "port__tvalid", "offered", WITHDRAWN)
    found = run(slopes_design, tmp_path, text)
    assert found.violations > 0
    assert found.differences == 0
    assert "normals: an offer was withdrawn or changed" in found.first


def test_a_wrong_expectation_is_found(depth_design, icarus_verilog, tmp_path):
    words = depth_design.result.depth_words.copy()
    words[2, 3, 4] ^= 1
    found = run(
        depth_design, tmp_path, result=replace(depth_design.result, depth_words=words), unknown_idle=True
    )
    assert found.differences == 1
    assert found.first.startswith("depth: beat ")


def test_a_hanging_design_ends_in_one_line(depth_design, icarus_verilog, tmp_path):
    text = changed(depth_design.verilog, "interrupt", "", NO_INTERRUPT)
    with pytest.raises(SimulatorError, match=r"came to no end: no end after \d+ clocks"):
        run(depth_design, tmp_path, text)


def test_what_is_no_verilog_ends_in_one_line(depth_design, icarus_verilog, tmp_path):
    with pytest.raises(SimulatorError, match=r"^iverilog: "):
        run(depth_design, tmp_path, "module fastac(; endmodule")
