"""Simulation with cocotb and Verilator: outputs compared bit by bit, latencies cycle by cycle."""
