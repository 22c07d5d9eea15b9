"""Reports of Vivado: short excerpts of genuine ones, and, marked as such, ones written by hand in the format.

Genuine: of the package edalize 0.6.8 (BSD-2-Clause, copyright edalize contributors), folder
tests/test_reporting/data of its source distribution: linux-on-litex-vexriscv/arty_a7 (an XC7A35T, timing met)
and picorv32/vivado-artix7/impl (an XC7A200T, timing not met), both by Vivado 2019.2. Most rows are left out.
"""

LITEX_UTILISATION = """\
Copyright 1986-2019 Xilinx, Inc. All Rights Reserved.
------------------------------------------------------------------------------------
| Tool Version : Vivado v.2019.2 (lin64) Build 2708876 Wed Nov  6 21:39:14 MST 2019
| Command      : report_utilization -file top_utilization_place.rpt
| Design       : top
| Device       : 7a35ticsg324-1L
| Design State : Fully Placed
------------------------------------------------------------------------------------

1. Slice Logic
--------------

+----------------------------+------+-------+-----------+-------+
|          Site Type         | Used | Fixed | Available | Util% |
+----------------------------+------+-------+-----------+-------+
| Slice LUTs                 | 8297 |     0 |     20800 | 39.89 |
|   LUT as Logic             | 6363 |     0 |     20800 | 30.59 |
| Slice Registers            | 5434 |     0 |     41600 | 13.06 |
+----------------------------+------+-------+-----------+-------+

3. Memory
---------

+-------------------+------+-------+-----------+-------+
|     Site Type     | Used | Fixed | Available | Util% |
+-------------------+------+-------+-----------+-------+
| Block RAM Tile    | 29.5 |     0 |        50 | 59.00 |
|   RAMB36/FIFO*    |   16 |     0 |        50 | 32.00 |
+-------------------+------+-------+-----------+-------+

4. DSP
------

+----------------+------+-------+-----------+-------+
|    Site Type   | Used | Fixed | Available | Util% |
+----------------+------+-------+-----------+-------+
| DSPs           |    4 |     0 |        90 |  4.44 |
|   DSP48E1 only |    4 |       |           |       |
+----------------+------+-------+-----------+-------+
"""
_TIMING = """\
| Tool Version : Vivado v.2019.2 (lin64) Build 2708876 Wed Nov  6 21:39:14 MST 2019
| Device       : {device}

------------------------------------------------------------------------------------------------
| Timer Settings
| --------------
------------------------------------------------------------------------------------------------

  Enable Multi Corner Analysis               :  Yes

------------------------------------------------------------------------------------------------
| Design Timing Summary
| ---------------------
------------------------------------------------------------------------------------------------

    WNS(ns)      TNS(ns)  TNS Failing Endpoints  TNS Total Endpoints      WHS(ns)      THS(ns)  THS Failing \
Endpoints  THS Total Endpoints     WPWS(ns)     TPWS(ns)  TPWS Failing Endpoints  TPWS Total Endpoints
    -------      -------  ---------------------  -------------------      -------      -------  ------------\
---------  -------------------     --------     --------  ----------------------  --------------------
{row}


{verdict}


------------------------------------------------------------------------------------------------
| Clock Summary
| -------------
------------------------------------------------------------------------------------------------

Clock                Waveform(ns)         Period(ns)      Frequency(MHz)
-----                ------------         ----------      --------------
{clock}


------------------------------------------------------------------------------------------------
| Intra Clock Table
| -----------------
------------------------------------------------------------------------------------------------
"""
LITEX_TIMING = _TIMING.format(
    device="7a35ti-csg324",
    row="      0.248        0.000                      0                32465        0.033        0.000"
    "                      0                32461        0.264        0.000                       0"
    "                  8085  ",
    verdict="All user specified timing constraints are met.",
    clock="clk100               {0.000 5.000}        10.000          100.000         ",
)
PICORV32_TIMING = _TIMING.format(
    device="7a200t-ffv1156",
    row="     -3.463       -4.140                     10                 2371        0.097        0.000"
    "                      0                 2371        1.370        0.000                       0"
    "                  1024  ",
    verdict="Timing constraints are not met.",
    clock="clk    {0.000 2.500}        5.000           200.000         ",
)
ULTRASCALE_UTILISATION = """\
| Tool Version : Vivado v.2023.2 (lin64) Build 4029153 Fri Oct 13 20:13:54 MDT 2023
| Design       : system_wrapper
| Device       : xczu19eg-ffvc1760-2-i
| Speed File   : -2
| Design State : Routed

+----------------------------+-------+-------+------------+-----------+-------+
|          Site Type         |  Used | Fixed | Prohibited | Available | Util% |
+----------------------------+-------+-------+------------+-----------+-------+
| CLB LUTs*                  | 61234 |     0 |          0 |    522720 | 11.71 |
| CLB Registers              | 80123 |     0 |          0 |   1045440 |  7.66 |
| CARRY8                     |  4321 |     0 |          0 |     65340 |  6.61 |
| Block RAM Tile             |  40.5 |     0 |          0 |       984 |  4.12 |
| URAM                       |     0 |     0 |          0 |       128 |  0.00 |
| DSPs                       |   662 |     0 |          0 |      1968 | 33.64 |
|   DSP48E2 only             |   662 |       |            |           |       |
+----------------------------+-------+-------+------------+-----------+-------+
"""
"""Written by hand after the format of Vivado 2023.2; its figures are invented."""
HIERARCHY = """\
| Design       : system_wrapper

+----------------------+--------------------+------------+------------+---------+------+-------+--------+--------+------+------------+
|       Instance       |       Module       | Total LUTs | Logic LUTs | LUTRAMs | SRLs |  FFs  | RAMB36 | RAMB18 | URAM | DSP Blocks |
+----------------------+--------------------+------------+------------+---------+------+-------+--------+--------+------+------------+
| system_wrapper       |              (top) |      61234 |      60000 |    1000 |  234 | 80123 |     30 |     21 |    0 |        662 |
|   system_i           |             system |      61234 |      60000 |    1000 |  234 | 80123 |     30 |     21 |    0 |        662 |
|     axi_dma_0        | system_axi_dma_0_0 |       2000 |       1900 |      50 |   50 |  3000 |      4 |      0 |    0 |          0 |
|     fastac_0         |  system_fastac_0_0 |      55555 |      55000 |     500 |   55 | 70000 |     26 |     21 |    0 |        662 |
+----------------------+--------------------+------------+------------+---------+------+-------+--------+--------+------+------------+
"""  # noqa: E501
"""Written by hand after the format of `report_utilization -hierarchical`; its figures are invented."""
POWER = """\
| Command          : report_power -file power.rpt
| Device           : xczu19eg-ffvc1760-2-i

1. Summary
----------

+--------------------------+--------------+
| Total On-Chip Power (W)  | 4.321        |
| Design Power Budget (W)  | Unspecified* |
| Power Budget Margin (W)  | NA           |
| Dynamic (W)              | 3.300        |
| Device Static (W)        | 1.021        |
| Effective TJA (C/W)      | 0.7          |
| Junction Temperature (C) | 28.1         |
| Confidence Level         | Medium       |
+--------------------------+--------------+
"""
"""Written by hand after the format of `report_power`; its figures are invented."""
