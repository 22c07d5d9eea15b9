"""The core's description for FuseSoC (CAPI2), which also leads Edalize to run Vivado out of context."""

CORE_FILE = "fastac.core"


def core_file(name: str, *, verilog: str, constraints: str, part: str, description: str) -> str:
    """The text of the core file; paths are from its folder, `name` is the Verilog's module.

    Targets: `default` for designs that use the core, `lint` by Verilator, `synth` for a project of Vivado
    that synthesises the core alone.
    """
    return f"""\
CAPI=2:
name: fastac:sensor:{name}:1.0.0
description: {description}

filesets:
  rtl:
    files:
      - {verilog}: {{file_type: verilogSource}}
  out_of_context:
    files:
      - {constraints}: {{file_type: xdc}}

targets:
  default: &default
    filesets: [rtl]
    toplevel: {name}
  lint:
    <<: *default
    flow: lint
    flow_options:
      tool: verilator
  synth:
    <<: *default
    filesets: [rtl, out_of_context]
    flow: vivado
    flow_options:
      part: {part}
      pnr: none
"""
