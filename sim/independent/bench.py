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
HANDSHAKES, BUS_BITS = 7, 36
"""Outputs that every design has: the interrupt and what offers or accepts; payloads of AXI4-Lite."""


def rendered(template: str, **values) -> str:
    """The text of a template beside this file."""
    return _TEMPLATES.get_template(template).render(**values)


def text(template: str, stimulus: Stimulus, top: str) -> str:
    """The bench of a design with top module `top` for what `stimulus` says, such as of "bench.v.j2"."""
    return rendered(
        template,
        top=top,
        octets=stimulus.octets,
        frames=stimulus.frames,
        beats=stimulus.beats,
        per_frame=stimulus.per_frame,
        clean=stimulus.clean,
        pace=stimulus.pace,
        unknown_idle=stimulus.unknown_idle,
        accesses=stimulus.accesses,
        limit=stimulus.limit,
        streams=stimulus.streams,
        handshake_bits=HANDSHAKES + len(stimulus.streams),
        payload_bits=BUS_BITS + sum(s.payload_bits for s in stimulus.streams),
    )
