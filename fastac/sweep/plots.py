"""Plots of errors against costs: interactive ones for the page, and pictures."""

from collections.abc import Sequence
from itertools import cycle
from pathlib import Path

import plotly.graph_objects as go
from matplotlib.figure import Figure
from plotly.subplots import make_subplots

from fastac.report.figures import save_png
from fastac.report.log_ticks import log_ticks
from fastac.report.plotly_look import AXIS, LAYOUT
from fastac.report.tables import number
from fastac.report.vector import readable_log, readable_scale
from fastac.sweep import front
from fastac.sweep.front import COSTS, ERRORS
from fastac.sweep.results import Row
from fastac.sweep.shown import PAPER_CYCLES, PAPER_ERRORS, PAPER_LABEL, SHOWN, Trade, value_text

MARKS = ("#d9792a", "#a05fb4", "#c23b6e", "#6d8f2a", "#2a8f9d")
"""Colours of marked scenes, in their order."""


def _hover(row: Row) -> str:
    sensor = row.scene["sensor"]
    lines = [f"<b>{row.scene['name']}</b>, {sensor['width_px']} px, {sensor['channels']}"]
    lines += [f"{key} = {value_text(value)}" for key, value in row.axes.items()]
    lines += [f"{name}: {number(row.metrics[name])}" for name in (*ERRORS, *SHOWN) if name in row.metrics]
    return "<br>".join(lines)


def scale(rows: Sequence[Row], cost: str) -> str:
    """The scale of a cost's axis: linear over less than a decade, where a logarithm has too few labels."""
    values = [row.metrics[cost] for row in rows]
    paper = [PAPER_CYCLES] if cost == "latency_cycles" else []
    return "log" if min(values) > 0 and max(values + paper) > 10 * min(values) else "linear"


def figure(shown: Trade, error: str) -> go.Figure:
    """Error against each cost: all points, the front, marked scenes, confirmed points, the paper."""
    found = make_subplots(1, len(COSTS), shared_yaxes=True, horizontal_spacing=0.03)
    rows = front.with_metrics(shown.rows, (error,))
    for k, (cost, label) in enumerate(COSTS.items(), start=1):

        def add(rows: Sequence[Row], name: str, *, at=k, over=cost, **style) -> None:
            found.add_trace(
                go.Scatter(
                    x=[row.metrics[over] for row in rows],
                    y=[row.metrics[error] for row in rows],
                    text=[_hover(row) for row in rows],
                    hoverinfo="text",
                    name=name,
                    legendgroup=name,
                    showlegend=at == 1,
                    **style,
                ),
                1,
                at,
            )

        add(rows, "designs", mode="markers", marker={"size": 6, "color": "#9aa7b5"})
        line = {"shape": "hv", "color": "#1f6fb4"}
        add(front.front(rows, (error, cost)), "front", mode="lines+markers", line=line)
        confirmed = [row for row in rows if row.key in shown.confirmed]
        ring = {"size": 13, "symbol": "circle-open", "color": "#2a8f4e", "line": {"width": 2}}
        add(confirmed, "confirmed in RTL", mode="markers", marker=ring)
        for colour, (name, row) in zip(cycle(MARKS), shown.marked.items(), strict=False):
            if error in row.metrics:
                star = {"size": 14, "symbol": "star", "color": colour}
                add([row], f"scene {name}", mode="markers", marker=star)
        if cost == "latency_cycles" and error in PAPER_ERRORS:
            found.add_trace(
                go.Scatter(
                    x=[PAPER_CYCLES],
                    y=[PAPER_ERRORS[error]],
                    text=[PAPER_LABEL],
                    name=PAPER_LABEL,
                    mode="markers",
                    hoverinfo="text+x+y",
                    marker={"size": 13, "symbol": "diamond", "color": "#c0392b"},
                ),
                1,
                k,
            )
        across, up = shown_values(rows, cost, error)
        found.update_xaxes(title_text=label, type=scale(rows, cost), row=1, col=k)
        if scale(rows, cost) == "log":
            found.update_xaxes(**ticks(across), row=1, col=k)
        if cost == "latency_cycles":
            found.update_yaxes(title_text=ERRORS[error], row=1, col=k)
            found.update_yaxes(type="log", **ticks(up))
    for axes in (found.update_xaxes, found.update_yaxes):
        axes(**AXIS)
    legend = {"orientation": "h", "y": -0.2}
    found.update_layout(height=520, margin={"t": 20, "r": 20}, legend=legend, **LAYOUT)
    return found


def shown_values(rows: Sequence[Row], cost: str, error: str) -> tuple[list[float], list[float]]:
    """All values of a cost and of an error that a plot of them shows, the paper's among them where it is."""
    across, up = [row.metrics[cost] for row in rows], [row.metrics[error] for row in rows]
    if cost == "latency_cycles" and error in PAPER_ERRORS:
        return [*across, PAPER_CYCLES], [*up, PAPER_ERRORS[error]]
    return across, up


def ticks(values: Sequence[float]) -> dict:
    """Plotly's keywords for the labels of a logarithmic axis on which these values are."""
    known = [value for value in values if value > 0]
    if not known:
        return {}
    places, labels = log_ticks(min(known), max(known))
    return {"tickvals": places, "ticktext": labels, "tickangle": 0}


def picture(shown: Trade, error: str, path: Path) -> None:
    """The same plot as a PNG file."""
    plot = Figure(figsize=(5 * len(COSTS), 4.2))
    panels = plot.subplots(1, len(COSTS), sharey=True)
    rows = front.with_metrics(shown.rows, (error,))
    for panel, (cost, label) in zip(panels, COSTS.items(), strict=True):

        def at(rows: Sequence[Row], over=cost) -> tuple[list[float], list[float]]:
            return [row.metrics[over] for row in rows], [row.metrics[error] for row in rows]

        panel.plot(*at(rows), ".", color="#9aa7b5", label="designs")
        panel.step(*at(front.front(rows, (error, cost))), "o-", where="post", markersize=4, label="front")
        confirmed = [row for row in rows if row.key in shown.confirmed]
        if confirmed:
            panel.plot(
                *at(confirmed), "o", color="#2a8f4e", markersize=9, fillstyle="none", label="confirmed in RTL"
            )
        for colour, (name, row) in zip(cycle(MARKS), shown.marked.items(), strict=False):
            if error in row.metrics:
                panel.plot(*at([row]), "*", color=colour, markersize=12, label=f"scene {name}")
        if cost == "latency_cycles" and error in PAPER_ERRORS:
            panel.plot(PAPER_CYCLES, PAPER_ERRORS[error], "D", color="#c0392b", label=PAPER_LABEL)
        across, up = shown_values(rows, cost, error)
        readable_scale(panel.xaxis, min(across), max(across))
        if cost == "latency_cycles" and min(up) > 0:
            readable_log(panel.yaxis, min(up), max(up))
        panel.set_xlabel(label)
        panel.grid(alpha=0.3, which="both")
    panels[0].set_ylabel(ERRORS[error])
    panels[0].legend(fontsize=7)
    save_png(plot, path)
