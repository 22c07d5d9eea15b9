"""Counts known by hand."""

import json

import pytest

from fastac.gateware.target import tools
from fastac.gateware.target.tools import ToolError
from fastac.synth import yosys


@pytest.mark.usefixtures("synthesis_tools")
def test_counts_known_by_hand(modules, tmp_path):
    product = yosys.count(modules["left"], tmp_path)
    blocks = ("dsp48e2", "ramb36e2", "ramb18e2", "uram288", "srl16e", "srlc32e")
    assert product == dict(zip(blocks, (1, 0, 0, 0, 0, 0), strict=True))
    # 20 stages: more than an SRL16E holds, so one SRLC32E.
    delay = yosys.count(modules["delay"], tmp_path)
    assert delay == dict(zip(blocks, (0, 0, 0, 0, 0, 1), strict=True))
    assert not any(yosys.count(modules["top (own logic)"], tmp_path).values())
    registers = yosys.dsp_registers(modules["left"], tmp_path)
    assert registers == {"dsp": 1, "a": 1, "b": 1, "m": 1, "p": 1}


@pytest.mark.usefixtures("synthesis_tools")
def test_look_up_tables_known_by_hand(modules, tmp_path):
    # The product is a DSP's; Yosys leaves the sum of 31 bits outside, one look-up table a bit.
    product = yosys.luts(modules["left"], tmp_path)
    assert product["lut"] in (30, 31)
    assert (product["lut_as_memory"], product["carry8"]) == (0, 4)
    # 20 stages are one SRLC32E, which is a look-up table.
    delay = yosys.luts(modules["delay"], tmp_path)
    assert delay == {"lut": 1, "lut_as_memory": 1, "carry8": 0}
    # A difference of 32 bits, one look-up table a bit and eight bits a carry chain, and a 5-bit counter.
    own = yosys.luts(modules["top (own logic)"], tmp_path)
    assert own["lut_as_memory"] == 0
    assert 32 <= own["lut"] <= 32 + 2 * 5
    assert own["carry8"] in (4, 5)


def test_distributed_ram_of_unknown_size_is_refused(modules, tmp_path, monkeypatch):
    kinds = {"LUT6": 3, "RAM32M16": 2, "RAMB36E2": 1, "CARRY4": 3}

    def run(name, arguments, folder):
        content = json.dumps({"design": {"num_cells_by_type": kinds}})
        (folder / "count.json").write_text(content)

    monkeypatch.setattr(tools, "run", run)
    part = modules["delay"]
    assert yosys.luts(part, tmp_path) == {"lut": 19, "lut_as_memory": 16, "carry8": 2}
    kinds["RAM7"] = 1
    with pytest.raises(ToolError, match=r"^RAM7: its look-up tables are not known$"):
        yosys.luts(part, tmp_path)
