"""Target figures for the virtual fingertip on its held-out grid, and whether they are reached."""

from fastac.report.headline import Headline
from fastac.report.paper import GRADIENT_MAE_MM_PER_PX, GRADIENT_REDUCTION_PERCENT
from fastac.report.tables import Table, number
from fastac.scenes.schema import AXES

GRADIENT_MM_PER_PX = GRADIENT_MAE_MM_PER_PX["bgr+nir"]["total"]
REDUCTION_PERCENT = GRADIENT_REDUCTION_PERCENT["total"]
DEPTH_MM = 0.0208
"""Half of the paper's error."""
PRIOR_GAIN = 5
"""Depth error without the boundary prior over that with it."""
NMAE_PERCENT = 1.4
"""Of each component of the force: about half of the paper's."""
KERNEL_GAIN = 3
"""Error of F_z with the fixed kernel over that with the dynamic one."""


def goals(sections: dict[str, dict]) -> list[dict]:
    """One entry per goal whose figures are in `sections`: what, unit, ours, at_most or at_least, reached.

    Forces are HyperForce's on displacements measured in the frames.
    """
    found = []

    def goal(what: str, ours: float, unit: str, *, at_most=None, at_least=None) -> None:
        bound = {"at_most": at_most} if at_least is None else {"at_least": at_least}
        reached = ours <= at_most if at_least is None else ours >= at_least
        found.append({"what": what, "unit": unit, "ours": ours, **bound, "reached": bool(reached)})

    if "geometry" in sections:
        geometry = sections["geometry"]
        nir = geometry["channels"]["bgr+nir"]
        total, depth = nir["gradient_mae_mm_per_px"]["total"], nir["depth_mae_mm"]
        goal("gradient MAE, RGB-NIR", total, "mm/px", at_most=GRADIENT_MM_PER_PX)
        reduction = geometry["gradient_reduction_percent"]["total"]
        goal("gradient MAE, RGB-NIR below RGB-only", reduction, "%", at_least=REDUCTION_PERCENT)
        goal("depth MAE with prior", depth["prior"], "mm", at_most=DEPTH_MM)
        gain = depth["no_prior"] / depth["prior"]
        goal("depth MAE without prior over that with", gain, "times", at_least=PRIOR_GAIN)
    if "forces" in sections:
        results = sections["forces"]["displacements"]["found"]["results"]
        full, fixed = results["dynamic xyz"], results["fixed xyz"]
        for axis, nmae in zip(AXES, full["nmae_percent"], strict=True):
            goal(f"F_{axis}, NMAE", nmae, "%", at_most=NMAE_PERCENT)
        gain = fixed["mae_n"][2] / full["mae_n"][2]
        goal("F_z, MAE of the fixed kernel over the dynamic one's", gain, "times", at_least=KERNEL_GAIN)
    return found


def table(found: list[dict]) -> Table:
    """The goals, and whether they are reached."""
    rows = [
        [goal["what"], number(goal["ours"]), _bound(goal), goal["unit"], _reached(goal)] for goal in found
    ]
    note = "Held-out grid. Of goals not reached, see “What limits it”."
    return Table("Goals", ["figure", "ours", "goal", "unit", ""], rows, note)


def headlines(found: list[dict]) -> list[Headline]:
    """The goals for the top of the page: what was measured, and beside it the goal."""
    return [
        Headline(
            goal["what"], f"{number(goal['ours'])} {goal['unit']}", f"goal {_bound(goal)}: {_reached(goal)}"
        )
        for goal in found
    ]


def _bound(goal: dict) -> str:
    return f"≤ {goal['at_most']:g}" if "at_most" in goal else f"≥ {goal['at_least']:g}"


def _reached(goal: dict) -> str:
    return "reached" if goal["reached"] else "NOT reached"
