"""Our models of block RAM and DSP cells against what the user guides say, written once more in Python."""

import subprocess

import numpy as np
import pytest

from fastac.sim.independent import icarus, primitives

CONTROLS = (
    ".ADDRENA(1'b1), .ADDRENB(1'b1), .SLEEP(1'b0), .REGCEAREGCE(1'b0), .REGCEB(1'b0), .RSTREGARSTREG(1'b0),"
    " .RSTREGB(1'b0), .RSTRAMARSTRAM(1'b0), .RSTRAMB(1'b0)"
)
REGISTERS = (
    "ACASC",
    "AD",
    "ALUMODE",
    "A",
    "BCASC",
    "B",
    "CARRYIN",
    "CARRYINSEL",
    "C",
    "D",
    "INMODE",
    "M",
    "OPMODE",
    "P",
)


def simulate(folder, text):
    """The lines that a bench prints with our models, without warnings."""
    models = [str(path) for path in primitives.write(folder)]
    (folder / "bench.v").write_text(text)
    command = ["iverilog", icarus.DIALECT, "-s", "bench", "-o", "bench.vvp", "bench.v", *models]
    subprocess.run(command, cwd=folder, check=True)
    done = subprocess.run(["vvp", "-N", "bench.vvp"], cwd=folder, capture_output=True, text=True, check=True)
    return [line for line in done.stdout.splitlines() if "$finish" not in line]


def dsp_bench(operations, *, opmode="000000101", **changed):
    values = {f"{name}REG": 0 for name in REGISTERS} | changed
    parameters = ", ".join(f".{name}({value})" for name, value in values.items())
    steps = "\n".join(f'    a = {a}; b = {b}; #1 $display("%0d", $signed(p));' for a, b in operations)
    return f"""
module bench;
  reg signed [29:0] a;
  reg signed [17:0] b;
  wire [47:0] p;
  DSP48E2 #({parameters}) dsp(.A(a), .B(b), .ALUMODE(4'd0), .INMODE(5'd0), .OPMODE(9'b{opmode}),
    .CARRYINSEL(3'd0), .CARRYIN(1'b0), .P(p));
  initial begin
{steps}
  end
endmodule
"""


def test_products(icarus_verilog, tmp_path):
    rng = np.random.default_rng(1)
    ends = [(a, b) for a in (-(1 << 26), (1 << 26) - 1, 0) for b in (-(1 << 17), (1 << 17) - 1, -1)]
    drawn = zip(rng.integers(-(1 << 26), 1 << 26, 50), rng.integers(-(1 << 17), 1 << 17, 50), strict=True)
    operations = [*ends, *((int(a), int(b)) for a, b in drawn)]
    assert simulate(tmp_path, dsp_bench(operations)) == [str(a * b) for a, b in operations]


@pytest.mark.parametrize(
    ("changed", "reason"),
    [({"MREG": 1}, "a mode of DSP48E2"), ({"opmode": "000110101"}, "an operation of DSP48E2")],
    ids=["register", "sum"],
)
def test_what_the_dsp_model_does_not_have_stops(changed, reason, icarus_verilog, tmp_path):
    assert reason in simulate(tmp_path, dsp_bench([(3, 5)] * 3, **changed))[0]


def ram_bench(name, count, address_bits, lanes, **parameters):
    """A bench that performs `count` operations of operations.hex and prints what both ports then show."""
    given = ", ".join(f".{key}({value})" for key, value in parameters.items())
    return f"""
module bench;
  reg clk = 0;
  reg [127:0] operations [0:{count - 1}];
  reg [127:0] now;
  integer k;
  wire [{8 * lanes - 1}:0] a, b;
  wire [{lanes - 1}:0] ap, bp;
  {name} #({given}) ram(.CLKARDCLK(clk), .CLKBWRCLK(clk), .ENARDEN(now[127]), .ENBWREN(now[126]),
    .WEA(now[120 +: {lanes}]), .WEBWE(now[112 +: {2 * lanes}]), {CONTROLS},
    .ADDRARDADDR(now[96 +: {address_bits}]), .ADDRBWRADDR(now[80 +: {address_bits}]),
    .DINADIN(now[0 +: {8 * lanes}]), .DINPADINP(now[32 +: {lanes}]),
    .DINBDIN(now[40 +: {8 * lanes}]), .DINPBDINP(now[72 +: {lanes}]),
    .DOUTADOUT(a), .DOUTPADOUTP(ap), .DOUTBDOUT(b), .DOUTPBDOUTP(bp));
  initial begin
    $readmemh("operations.hex", operations);
    #1 $display("%b %b %b %b", ap, a, bp, b);
    for (k = 0; k < {count}; k = k + 1) begin
      now = operations[k];
      #1 clk = 1;
      #1 clk = 0;
      $display("%b %b %b %b", ap, a, bp, b);
    end
  end
endmodule
"""


def operation(**fields):
    """A word of operations.hex."""
    places = {"ena": 127, "enb": 126, "wea": 120, "web": 112, "a": 96, "b": 80}
    places |= {"da": 0, "pa": 32, "db": 40, "pb": 72}
    return f"{sum(value << places[key] for key, value in fields.items()):032x}"


def perform(folder, name, address_bits, lanes, operations, **parameters):
    """What the ports show at the start and after each operation: parity and data of A and of B."""
    (folder / "operations.hex").write_text("\n".join(operations) + "\n")
    return [
        line.split()
        for line in simulate(folder, ram_bench(name, len(operations), address_bits, lanes, **parameters))
    ]


@pytest.mark.parametrize("mode", ["READ_FIRST", "WRITE_FIRST", "NO_CHANGE"])
@pytest.mark.parametrize(("name", "address_bits", "lanes"), [("RAMB36E2", 15, 4), ("RAMB18E2", 14, 2)])
@pytest.mark.parametrize("width", [1, 4, 9, 18])
def test_a_port_reads_and_writes(name, address_bits, lanes, width, mode, icarus_verilog, tmp_path):
    """Port A writes and reads few words at random, with bytes enabled at random, and B reads other ones."""
    rng = np.random.default_rng(width)
    data = width // 9 * 8 or width
    parity, shift = width - data, data.bit_length() - 1
    words = [0xA5 >> data * k & ((1 << data) - 1) for k in range(8)]  # INIT_00's first byte is 0xa5
    seen_a = seen_b = 0
    expected, operations = [], []
    for _ in range(60):
        a, b = (int(n) for n in rng.choice(8, 2, replace=False))
        new = int(rng.integers(1 << width))
        lanes_used = max(parity, 1)
        enables = int(rng.integers(1 << lanes_used)) if rng.random() < 0.6 else 0
        both = int(rng.random() < 0.9)
        wea = enables if lanes_used > 1 else enables * ((1 << lanes) - 1)
        fields = {"ena": both, "enb": 1, "wea": wea, "a": a << shift, "b": b << shift}
        operations.append(operation(**fields, da=new & ((1 << data) - 1), pa=new >> data))
        seen_b = words[b]
        if both:
            old = words[a]
            for k in range(lanes_used):
                if enables >> k & 1:
                    mask = (0xFF << 8 * k | 1 << data + k) & ((1 << width) - 1)
                    words[a] = words[a] & ~mask | new & mask
            if not enables or mode == "READ_FIRST":
                seen_a = old
            elif mode == "WRITE_FIRST":
                seen_a = words[a]
        expected.append((seen_a, seen_b))
    settings = {"READ_WIDTH_A": width, "WRITE_WIDTH_A": width, "READ_WIDTH_B": width}
    modes = {"WRITE_MODE_A": f'"{mode}"', "INIT_00": "256'ha5", "DOA_REG": 0, "DOB_REG": 0}
    found = perform(tmp_path, name, address_bits, lanes, operations, **settings, **modes)
    assert found[0] == ["0" * n for n in (lanes, 8 * lanes) * 2]
    for line, (of_a, of_b) in zip(found[1:], expected, strict=True):
        values = [int(p, 2) << data | int(d, 2) for p, d in (line[:2], line[2:])]
        assert values == [of_a, of_b]


def test_simple_dual_port_of_full_width(icarus_verilog, tmp_path):
    """Writes at B take the inputs of both ports, reads at A use the outputs of both."""
    write = {"enb": 1, "web": 0xFF, "b": 5 << 6, "da": 0x01234567, "pa": 9, "db": 0x89ABCDEF, "pb": 6}
    part = {"enb": 1, "web": 0x10, "b": 5 << 6, "da": 0, "pa": 0, "db": 0x000000AA, "pb": 0}
    read = {"ena": 1, "a": 5 << 6}
    settings = {"READ_WIDTH_A": 72, "WRITE_WIDTH_B": 72, "DOA_REG": 0, "DOB_REG": 0}
    operations = [operation(**fields) for fields in (write, read, part, read)]
    found = perform(tmp_path, "RAMB36E2", 15, 4, operations, **settings)
    assert [int(n, 2) for n in found[2]] == [9, 0x01234567, 6, 0x89ABCDEF]
    assert [int(n, 2) for n in found[4]] == [9, 0x01234567, 6, 0x89ABCDAA]


@pytest.mark.parametrize(("mode", "known"), [("READ_FIRST", True), ("NO_CHANGE", False)])
def test_a_read_of_what_is_being_written(mode, known, icarus_verilog, tmp_path):
    settings = {"READ_WIDTH_A": 36, "WRITE_WIDTH_B": 36, "DOA_REG": 0, "DOB_REG": 0}
    both = operation(ena=1, enb=1, web=0xF, a=3 << 5, b=3 << 5, db=77)
    modes = {"WRITE_MODE_A": f'"{mode}"', "WRITE_MODE_B": f'"{mode}"'}
    found = perform(tmp_path, "RAMB36E2", 15, 4, [both, operation(ena=1, a=3 << 5)], **settings, **modes)
    assert found[1][1] == ("0" if known else "x") * 32
    assert int(found[2][1], 2) == 77


def test_what_the_ram_model_does_not_have_stops(icarus_verilog, tmp_path):
    settings = {"READ_WIDTH_A": 36, "DOA_REG": 1, "DOB_REG": 0}
    text = ram_bench("RAMB36E2", 1, 15, 4, **settings)
    (tmp_path / "operations.hex").write_text(operation() + "\n")
    assert "a mode that our model does not have" in simulate(tmp_path, text)[0]
