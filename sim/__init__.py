"""cocotb and Verilator benches: bit-exact values, exact cycle counts."""
