"""The core's description for FuseSoC (CAPI2), which also leads Edalize to run Vivado out of context."""

CORE_FILE = "fastac.core"
OUT_OF_CONTEXT = """\
# Sourced by Edalize's project: the core has no pins of the package, so no buffers are put at its ports.
set_property -name {STEPS.SYNTH_DESIGN.ARGS.MORE OPTIONS} -value {-mode out_of_context} \\
    -objects [get_runs synth_1]
"""
"""Text of the script that the target `synth` names."""


def core_file(
    name: str, *, verilog: str, constraints: str, script: str, waivers: str, part: str, description: str
) -> str:
    """The text of the core file; paths are from its folder, `name` is the Verilog's module.

    Targets: `default` for designs that use the core; `lint` by Verilator, with the project's `waivers`;
    `synth` for a project of Vivado that synthesises the core alone.
    """
    return f"""\
CAPI=2:
name: fastac:sensor:{name}:1.0.0
description: {description}

filesets:
  rtl:
    files:
      - {verilog}: {{file_type: verilogSource}}
  waivers:
    files:
      - {waivers}: {{file_type: vlt}}
  out_of_context:
    files:
      - {constraints}: {{file_type: xdc}}
      - {script}: {{file_type: tclSource}}

targets:
  default: &default
    filesets: [rtl]
    toplevel: {name}
  lint:
    <<: *default
    filesets: [waivers, rtl]
    flow: lint
    flow_options:
      tool: verilator
      verilator_options: [-Wall]
  synth:
    <<: *default
    filesets: [rtl, out_of_context]
    flow: vivado
    flow_options:
      part: {part}
      pnr: none
"""
