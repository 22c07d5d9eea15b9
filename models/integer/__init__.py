"""The golden model's arithmetic: each stage of the integer pipeline, defined once.

Training, emulator, benches and hardware share these classes. Each is a frozen set of tables and widths
that checks itself and is called on int64 arrays; hardware equals it bit for bit.
Equations: Lu et al., "FasTac", section "FPGA-Based Edge Deployment".
"""
