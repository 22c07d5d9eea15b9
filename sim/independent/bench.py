"""The texts of the independent benches, from templates beside this file."""

import jinja2

from fastac.sim.independent.stimulus import Stimulus

_TEMPLATES = jinja2.Environment(
    loader=jinja2.PackageLoader("fastac.sim", "independent"),
    autoescape=False,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
HOST_BITS = 44
"""Bits of the outputs that every design has: interrupt, ready of the camera, and AXI4-Lite."""


def text(template: str, stimulus: Stimulus, top: str) -> str:
    """The bench of a design with top module `top` for what `stimulus` says, such as of "bench.v.j2"."""
    bits = HOST_BITS + sum(1 + s.payload_bits for s in stimulus.streams)
    return _TEMPLATES.get_template(template).render(
        top=top,
        octets=stimulus.octets,
        frames=stimulus.frames,
        beats=stimulus.beats,
        per_frame=stimulus.per_frame,
        clean=stimulus.clean,
        unknown_idle=stimulus.unknown_idle,
        accesses=stimulus.accesses,
        limit=stimulus.limit,
        streams=stimulus.streams,
        output_bits=bits,
    )
