# amaranth: UnusedElaboratable=no
"""Counts known by hand."""

import json

import numpy as np
import pytest
from amaranth import Const, Module, signed
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.dsp_slice import DSP48E1, DSP48E2
from fastac.gateware.arithmetic.product import product
from fastac.gateware.arithmetic.product_cascade import product_cascade
from fastac.gateware.dst1_engine import Dst1Engine
from fastac.gateware.mlp_mvm import MvmCore
from fastac.gateware.poisson.recurrence import RowRecurrence
from fastac.gateware.target import tools
from fastac.gateware.target.elaboration import to_rtlil
from fastac.gateware.target.tools import ToolError
from fastac.models import random_bundle
from fastac.models.integer.network import Layer
from fastac.synth import yosys
from fastac.synth.netlist import Part


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
    # The product and the sum behind it are a DSP's.
    product = yosys.luts(modules["left"], tmp_path)
    assert product == {"lut": 0, "lut_as_memory": 0, "carry8": 0}
    # 20 stages are one SRLC32E, which is a look-up table.
    delay = yosys.luts(modules["delay"], tmp_path)
    assert delay == {"lut": 1, "lut_as_memory": 1, "carry8": 0}
    # A difference of 32 bits, one look-up table a bit and eight bits a carry chain, and a 5-bit counter.
    own = yosys.luts(modules["top (own logic)"], tmp_path)
    assert own["lut_as_memory"] == 0
    assert 32 <= own["lut"] <= 32 + 2 * 5
    assert own["carry8"] in (4, 5)


@pytest.mark.full
@pytest.mark.usefixtures("yosys_alone")
def test_where_one_mapper_of_look_up_tables_ends_the_other_maps_them(modules, tmp_path, monkeypatch):
    part, scripts, run = modules["top (own logic)"], [], tools.run

    def ended(name, arguments, folder):
        scripts.append((folder / "script.ys").read_text())
        if "synth_xilinx" in scripts[-1] and ("abc -luts" not in scripts[-1] or always):
            raise ToolError("yosys-abc ended")
        run(name, arguments, folder)

    monkeypatch.setattr(tools, "run", ended)
    always = False
    found = yosys.luts(part, tmp_path)
    assert 32 <= found["lut"] <= 32 + 2 * 5
    assert found["carry8"] in (4, 5)
    always = True
    with pytest.raises(ToolError, match="yosys-abc ended"):
        yosys.luts(part, tmp_path)
    assert ["abc -luts" in script for script in scripts if "synth_xilinx" in script] == [False, True] * 2


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


class Products(wiring.Component):
    """Products of signed operands of these widths."""

    def __init__(self, widths):
        self.widths = widths
        members = {}
        for k, (a, b) in enumerate(widths):
            members |= {f"a{k}": In(signed(a)), f"b{k}": In(signed(b)), f"o{k}": Out(signed(a + b))}
        super().__init__(members)

    def elaborate(self, platform):
        m = Module()
        for k in range(len(self.widths)):
            a, b = getattr(self, f"a{k}"), getattr(self, f"b{k}")
            m.d.comb += getattr(self, f"o{k}").eq(product(m, platform, Const(1), a, b, name=f"product_{k}"))
        return m


WIDTHS = [(27, 18), (26, 18), (25, 18), (18, 27), (28, 18), (19, 19), (35, 18), (9, 8)]


def counted(design, dsp, folder) -> int:
    found = yosys.count(Part("design", to_rtlil(design, name="unit"), False), folder, yosys.TARGETS[dsp.name])
    return found[dsp.name.lower()]


@pytest.mark.parametrize("dsp", [DSP48E2, DSP48E1], ids=lambda dsp: dsp.name)
@pytest.mark.quick("DSP48E1")
@pytest.mark.usefixtures("yosys_alone")
def test_products_take_as_many_slices_as_the_formula_says(dsp, tmp_path):
    assert counted(Products(WIDTHS), dsp, tmp_path) == sum(dsp.slices(*widths) for widths in WIDTHS)


class Cascade(wiring.Component):
    """The sum of three products of signed operands of 27 × 16 bits and a constant."""

    def __init__(self):
        operands = {
            f"{name}{k}": In(signed(width)) for k in range(3) for name, width in (("a", 27), ("b", 16))
        }
        super().__init__({**operands, "o": Out(signed(44))})

    def elaborate(self, platform):
        m = Module()
        pairs = [(getattr(self, f"a{k}"), getattr(self, f"b{k}")) for k in range(3)]
        bounds = [(k << 41) + 5 for k in (1, 2, 3)]
        total = product_cascade(m, platform, Const(1), pairs, bounds, start=5, name="cascade")
        m.d.comb += self.o.eq(total)
        return m


@pytest.mark.full
@pytest.mark.usefixtures("yosys_alone")
def test_a_cascade_s_sums_take_no_look_up_tables(tmp_path):
    found = yosys.everything(Part("cascade", to_rtlil(Cascade(), name="unit"), False), tmp_path)
    assert (found["dsp48e2"], found["lut"]) == (3, 0)


@pytest.mark.full
@pytest.mark.usefixtures("yosys_alone")
def test_stages_take_as_many_slices_as_their_formulas_say(tmp_path):
    """With DSP48E1; resource_samples.json has the counts of whole designs with DSP48E2."""
    weight, bias = np.zeros((5, 3), int), np.zeros(5, int)
    for bits in (9, 10):  # packed and not
        layer = Layer(weight, bias, np.full(3, (1 << bits) - 1), loadable=True)
        tile = MvmCore(layer, input_width=bits, input_signed=False, dsp=DSP48E1)
        assert counted(tile, DSP48E1, tmp_path) == tile.multipliers
    wanted = random_bundle.scene(
        ("depth",), solver="tridiagonal", numbers={"gradient_fraction_bits": 14, "data_bits": 26}
    )
    solver = random_bundle.random_bundle(tmp_path / "bundle", wanted).pipeline.solver
    long_words = (
        Dst1Engine(solver.row_inverse, lanes=1, dsp=DSP48E1),
        RowRecurrence(solver.elimination, lanes=1, dsp=DSP48E1),
    )
    assert [stage.multipliers for stage in long_words] == [2 * 7, 2]
    assert [counted(stage, DSP48E1, tmp_path) for stage in long_words] == [2 * 7, 2]


@pytest.mark.full
@pytest.mark.usefixtures("yosys_alone")
def test_look_up_tables_and_memory_of_the_7_series(modules, tmp_path):
    target = yosys.TARGETS["DSP48E1"]
    delay = yosys.count(modules["delay"], tmp_path, target)
    assert delay == {"dsp48e1": 0, "ramb36e1": 0, "ramb18e1": 0, "srl16e": 0, "srlc32e": 1}
    # Eight bits a CARRY8 are two CARRY4.
    own = yosys.luts(modules["top (own logic)"], tmp_path, target)
    assert own["lut_as_memory"] == 0
    assert own["carry4"] in (8, 9, 10)
