"""What the study of depth found, as tables and as a picture."""

from collections.abc import Callable
from pathlib import Path

import matplotlib
import numpy as np

from fastac.report.figures import save_png
from fastac.report.tables import Table, mean_and_spread
from fastac.studies.depth.causes import AS_RECORDED, MENDED
from fastac.studies.depth.measure import PARTS

matplotlib.use("Agg")
import matplotlib.pyplot as plt

Chosen = Callable[[dict], bool]


def _between(kind: str, low: float, high: float) -> Chosen:
    return lambda press: press["kind"] == kind and low <= press["deepest_mm"] < high


DEPTHS_MM = ((0, 0.3), (0.3, 0.8), (0.8, np.inf))
WORDS = ("< 0.3 mm", "0.3 to 0.8 mm", "> 0.8 mm")
GROUPS: dict[str, Chosen] = {
    f"{name}, {words}": _between(kind, *depths)
    for kind, name in (("ball", "ball"), ("other", "others"))
    for words, depths in zip(WORDS, DEPTHS_MM, strict=True)
}
"""Presses to test with, by kind and true depth."""
KINDS = {"ball": ("#3f83c5", "the ball of training"), "other": ("#e07b28", "other bodies")}
"""Colours and labels of the presses to test with."""
RIM_RADII = 2.0
"""A contact is near the border where it is closer than so many of its radii."""


def means(content: dict, cause: str, key: str, chosen: Chosen) -> np.ndarray:
    """An error's mean over the chosen presses, of each seed, (seeds,)."""
    seeds = content["errors"][cause]
    return np.array([np.mean([press[key] for press in one if chosen(press)] or [np.nan]) for one in seeds])


def _cell(values: np.ndarray, sign: str = "+", digits: int = 1) -> str:
    return "" if np.isnan(values).any() else mean_and_spread(values, digits, sign)


def tables(content: dict) -> list[Table]:
    """The errors by cause, and by part of the skin for the training as recorded and the mended one."""
    causes = list(content["errors"])
    note = f"Simulated; mean and standard deviation over {len(content['seeds'])} seeds of means over presses."
    found = [
        Table(
            f"{title}, % of the true one",
            ["", *GROUPS],
            [
                [cause, *(_cell(means(content, cause, key, one)) for one in GROUPS.values())]
                for cause in causes
            ],
            note,
        )
        for key, title in (("depth", "Largest depth"), ("volume", "Volume below the skin at rest"))
    ]
    every = [_between(kind, 0, np.inf) for kind in KINDS]
    rows = [
        [
            cause,
            *(_cell(means(content, cause, "mae_um", chosen), "") for chosen in every),
            _cell(means(content, cause, "angle_rad", lambda press: True), "", 4),
        ]
        for cause in causes
    ]
    head = ["", "depth, ball, µm", "depth, others, µm", "slopes in contact, rad"]
    found.append(Table("Mean absolute errors over the image", head, rows, note))
    for cause in (AS_RECORDED, MENDED):
        if cause not in causes:
            continue
        rows = [
            [name, *(_cell(means(content, cause, part, one)) for part in ("depth", *PARTS))]
            for name, one in (GROUPS | _at_border()).items()
        ]
        lines = [f"{part}: {text}." for part, text in PARTS.items()]
        title = f"{cause}: error at the deepest point by its origin, % of the true depth"
        found.append(Table(title, ["", "largest depth", *PARTS], rows, "\n".join([note, *lines])))
    return found


def _at_border() -> dict[str, Chosen]:
    """Presses of the ball, 0.8 mm deep or more, near the border and away from it."""
    deep = _between("ball", *DEPTHS_MM[-1])
    return {
        "ball, > 0.8 mm, near the border": lambda press: deep(press) and press["border_radii"] < RIM_RADII,
        "ball, > 0.8 mm, away from it": lambda press: deep(press) and press["border_radii"] >= RIM_RADII,
    }


def write(content: dict, path: Path) -> None:
    """Write the picture: found over true depth of each press of the first seed, as recorded and mended."""
    shown = [cause for cause in (AS_RECORDED, MENDED) if cause in content["errors"]]
    figure, axes = plt.subplots(1, len(shown), figsize=(4.6 * len(shown), 3.6), squeeze=False, sharey=True)
    for axis, cause in zip(axes[0], shown, strict=True):
        for kind, (colour, label) in KINDS.items():
            presses = [press for press in content["errors"][cause][0] if press["kind"] == kind]
            deepest, error = ([press[key] for press in presses] for key in ("deepest_mm", "depth"))
            axis.plot(deepest, error, "o", color=colour, label=label, markersize=3)
        axis.axhline(0, color="#777777", linewidth=0.8)
        axis.set(xscale="log", ylim=(-60, 60), xlabel="true largest depth, mm", title=cause)
        axis.grid(alpha=0.2)
    axes[0][0].set_ylabel("error of the largest depth, %")
    axes[0][0].legend(fontsize=7)
    figure.tight_layout()
    save_png(figure, path)
    plt.close(figure)
