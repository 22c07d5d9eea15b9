"""The stages of a design, by the names of its instances: counts and estimates are sums over them."""

from fastac.synth.estimates.solvers import SOLVERS

BEFORE_SOLVER = {
    "background": "background",
    "smoothing": "smoothing",
    "mlp": "normals",
    "divider": "gradients",
    "solver.source": "source",
    "solver.row_forward": "transforms",
    "solver.row_inverse": "transforms",
}
BEHIND_SOLVER = {
    "depth_output": "depth",
    "displacement": "depth",
    "force_stream": "force",
    "bridge": "bridge",
    "darkness": "dots",
    "dots": "dots",
    "slip_stream": "slip",
}
"""Stages of every design by the names that instances begin with."""
BESIDE_SAMPLES = ("smoothing", "interval", "packets")
"""Stages of few designs, and of none of the samples: their look-up tables are counted by themselves."""


def stages() -> dict[str, str]:
    """Stages by the names that instances begin with, of all solvers; what is not here is "control"."""
    of_solvers = {
        f"solver.{name}": stage for costs in SOLVERS.values() for name, stage in costs.instances.items()
    }
    return BEFORE_SOLVER | of_solvers | BEHIND_SOLVER


def stage_names() -> tuple[str, ...]:
    """Each stage that a design of any solver may have, once, but `BESIDE_SAMPLES`."""
    names = dict.fromkeys(("control", *stages().values()))
    return tuple(name for name in names if name not in BESIDE_SAMPLES)


def stage_of(instance: str) -> str:
    """The stage that an instance of the elaborated design belongs to."""
    name = instance.removesuffix(" (own logic)")
    for prefix, stage in stages().items():
        if name == prefix or name.startswith(f"{prefix}."):
            return stage
    return "control"
