"""What a tuning found, as text and as a page with its curves."""

from pathlib import Path

from fastac.report.headline import Headline
from fastac.report.render import render
from fastac.report.tables import Table, number
from fastac.report.vector import drawing, inline_svg
from fastac.store.files import write_text

SCENE_COLOUR, CHOSEN_COLOUR = "#3f83c5", "#e07b28"
UNITS = {"rad": "rad", "deg": "°", "mm": "mm", "n": "N"}
LABELS = {
    "contact_gradient_angle_mae_rad": "gradients' error in contacts",
    "normal_mae_deg": "normals' error",
    "contact_depth_mae_mm": "depth error in contacts",
    "depth_mae_mm": "depth error",
    "force_mae_n": "force error",
}
SHOWN_AXES = 8
"""Axes that have a chart of their own, at most."""


def axes_text(axes: dict) -> str:
    """What a candidate sets, in one line, without the tables' names."""
    return ", ".join(f"{key.split('.')[-1]} {value}" for key, value in axes.items()) or "the scene itself"


def _unit(metric: str) -> str:
    return UNITS[metric.rsplit("_", 1)[-1]]


def labelled(metric: str) -> str:
    """The error's name and unit, as in the head of a row or beside an axis."""
    return f"{LABELS[metric]}, {_unit(metric)}"


def _value(metric: str, value: float) -> str:
    return f"{number(value)} {_unit(metric)}"


def _change(before: float, after: float) -> str:
    return f"{100 * (after / before - 1):+.1f}%"


def _seeds(content: dict) -> str:
    return f"{content['seeds']} seed{'s' if content['seeds'] > 1 else ''}"


def nested_table(content: dict) -> Table:
    """The errors on folds that had no say in the choice."""
    scene, chosen = content["nested"]["scene"], content["nested"]["chosen"]
    rows = [
        [
            labelled(name),
            *(f"{number(kind[name]['mean'])} ± {number(kind[name]['spread'])}" for kind in (scene, chosen)),
            _change(scene[name]["mean"], chosen[name]["mean"]),
        ]
        for name in content["metrics"]
    ]
    units = sum(map(len, content["folds"]))
    return Table(
        "Nested errors: on folds that had no say in the choice",
        ["error", "the scene", "chosen", "change"],
        rows,
        f"Floats; {units} groups or presses in {len(content['folds'])} folds, {_seeds(content)}: mean"
        " and spread (standard deviation) over the seeds. For each fold a"
        " choice of its own was made without it.",
    )


def test_table(content: dict) -> Table:
    """The errors on the split test."""
    rows = []
    for name in content["metrics"]:
        for arithmetic in ("float", "integer"):
            found = [[entry[arithmetic][name] for entry in entries] for entries in content["test"].values()]
            means = [sum(values) / len(values) for values in found]
            ranges = [
                f"{number(m)} ({number(min(v))} to {number(max(v))})"
                for m, v in zip(means, found, strict=True)
            ]
            rows.append([labelled(name), arithmetic, *ranges, _change(*means)])
    return Table(
        "Test: presses that were looked at once, now",
        ["error", "", "the scene", "winner", "change"],
        rows,
        f"Mean over {_seeds(content)}, and their range.",
    )


def candidates_table(content: dict) -> Table:
    """All candidates, the best first."""
    compared = ", ".join(LABELS[name] for name in content["metrics"])
    if len(content["metrics"]) > 1:
        compared = f"the geometric mean of {compared}"
    rows = []
    for candidate, axes in enumerate(content["candidates"]):
        key = str(candidate)
        errors = [rung.get(key) for rung in content["rungs"]]
        reached = max((k for k, error in enumerate(errors) if error is not None), default=-1)
        marks = ["winner"] * (candidate == content["winner"])
        marks += ["as good"] * (candidate in content["indistinguishable"] and not marks)
        marks += [content["refused"][key]] if key in content["refused"] else []
        shown = ["" if error is None else number(error) for error in errors]
        order = -reached, errors[reached] if reached >= 0 else 0.0
        rows.append((order, [axes_text(axes), *shown, "".join(marks)]))
    rows.sort(key=lambda row: row[0])
    return Table(
        "Candidates",
        ["candidate", *(f"rung {k + 1}" for k in range(len(content["rungs"]))), ""],
        [cells for _, cells in rows],
        f"Error by which they are compared: {compared}. Each rung leaves out more pairs of folds;"
        " “as good”: within one standard error of the best.",
    )


def tables(content: dict) -> list[Table]:
    found = [nested_table(content)]
    if content["test"]:
        found.append(test_table(content))
    return [*found, candidates_table(content)]


def folds_chart(content: dict) -> str:
    """An SVG: the error of each outer fold, of the scene and of what was chosen without the fold."""
    name = content["metrics"][0]
    with drawing(5, 2.8) as (figure, axis):
        places = range(1, len(content["folds"]) + 1)
        for kind, label, colour, shift in (
            ("scene", "the scene", SCENE_COLOUR, -0.2),
            ("chosen", "chosen without the fold", CHOSEN_COLOUR, 0.2),
        ):
            values = content["nested"][kind][name]["folds"]
            axis.bar([place + shift for place in places], values, 0.4, color=colour, label=label)
        axis.set_xticks(list(places))
        axis.set_xlabel("outer fold")
        axis.set_ylabel(labelled(name))
        axis.legend(loc="upper left", bbox_to_anchor=(0, 1.2), ncols=2)
        return inline_svg(figure)


def axis_charts(content: dict) -> list[str]:
    """For each key that was varied an SVG: the first rung's errors over its values, and their means."""
    first = {int(c): error for rung in content["rungs"][:1] for c, error in rung.items()}
    keys = list(dict.fromkeys(key for axes in content["candidates"] for key in axes))[:SHOWN_AXES]
    charts = []
    for key in keys:
        points = [
            (content["candidates"][c][key], e) for c, e in first.items() if key in content["candidates"][c]
        ]
        values = sorted({value for value, _ in points}, key=lambda value: (str(type(value)), value))
        with drawing(3.4, 2.4) as (figure, axis):
            for place, value in enumerate(values):
                errors = [error for other, error in points if other == value]
                axis.plot([place] * len(errors), errors, "o", markersize=4, color=SCENE_COLOUR, alpha=0.6)
                axis.plot(place, sum(errors) / len(errors), "_", markersize=18, color=CHOSEN_COLOUR)
            axis.set_xticks(range(len(values)), [str(value) for value in values])
            axis.set_xlim(-0.5, len(values) - 0.5)
            axis.set_ylabel("error, first rung")
            axis.set_title(key, loc="left")
            charts.append(inline_svg(figure))
    return charts


def headlines(content: dict) -> list[Headline]:
    """The nested error before and after, metric by metric."""
    scene, chosen = content["nested"]["scene"], content["nested"]["chosen"]
    return [
        Headline(
            LABELS[name],
            _value(name, chosen[name]["mean"]),
            f"nested; {_value(name, scene[name]['mean'])} of the scene,"
            f" {_change(scene[name]['mean'], chosen[name]['mean'])}",
        )
        for name in content["metrics"]
    ]


def write(content: dict, path: Path) -> None:
    """Write the page."""
    page = render(
        "tune/tune.html.j2",
        content=content,
        winner=axes_text(content["candidates"][content["winner"]]),
        headlines=headlines(content),
        tables=tables(content),
        folds=folds_chart(content),
        axes=axis_charts(content),
    )
    write_text(path, page)
