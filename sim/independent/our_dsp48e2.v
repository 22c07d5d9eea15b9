// Our model of DSP48E2 by the rules of AMD's user guide UG579: no register in use, one signed product of 27 x 18 bits.
//
// Multiplier operands with INMODE = 0 and AMULTSEL, BMULTSEL = A, B: A[26:0] and B (chapter 2, "Two's complement
// multiplier" and "INMODE"). OPMODE = 0_0000_0101: the multiplexers X and Y give the product, W and Z give 0 (tables of
// OPMODE). ALUMODE = 0: Z + W + X + Y + CIN, and CARRYINSEL = 0: CIN is CARRYIN. Whatever else is asked for stops the
// simulation; a parameter that is not listed here does not compile.
`default_nettype none

module DSP48E2 #(
  parameter ACASCREG = 1, ADREG = 1, ALUMODEREG = 1, AREG = 1, BCASCREG = 1, BREG = 1, CARRYINREG = 1,
  parameter CARRYINSELREG = 1, CREG = 1, DREG = 1, INMODEREG = 1, MREG = 1, OPMODEREG = 1, PREG = 1,
  parameter A_INPUT = "DIRECT", B_INPUT = "DIRECT", AMULTSEL = "A", BMULTSEL = "B",
  parameter USE_MULT = "MULTIPLY", USE_SIMD = "ONE48"
) (
  input wire [29:0] A, input wire [29:0] ACIN, input wire [17:0] B, input wire [17:0] BCIN, input wire [47:0] C,
  input wire [26:0] D, input wire [47:0] PCIN, input wire [3:0] ALUMODE, input wire [4:0] INMODE,
  input wire [8:0] OPMODE, input wire [2:0] CARRYINSEL, input wire CARRYIN, output wire [47:0] P
);
  wire signed [26:0] a = A[26:0];
  wire signed [17:0] b = B;
  wire signed [44:0] product = a * b;
  assign P = {{3{product[44]}}, product} + CARRYIN;

  initial begin
    if (ACASCREG + ADREG + ALUMODEREG + AREG + BCASCREG + BREG + CARRYINREG + CARRYINSELREG + CREG + DREG + INMODEREG
        + MREG + OPMODEREG + PREG != 0 || A_INPUT != "DIRECT" || B_INPUT != "DIRECT" || AMULTSEL != "A"
        || BMULTSEL != "B" || USE_MULT != "MULTIPLY" || USE_SIMD != "ONE48") begin
      $display("FIRST %m: a mode of DSP48E2 that our model does not have");
      $finish;
    end
    #1 if (ALUMODE !== 0 || INMODE !== 0 || OPMODE !== 9'b000000101 || CARRYINSEL !== 0) begin
      $display("FIRST %m: an operation of DSP48E2 that our model does not have");
      $finish;
    end
  end
endmodule
`default_nettype wire
