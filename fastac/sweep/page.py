"""The trade of speed against accuracy as an interactive page, as pictures, and as tables."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import plotly.graph_objects as go
from matplotlib.figure import Figure
from plotly.subplots import make_subplots

from fastac.report.figures import save_png
from fastac.report.paper import EDGE
from fastac.report.render import render
from fastac.report.tables import Table, number
from fastac.store.files import write_text
from fastac.sweep import front
from fastac.sweep.front import COSTS, ERRORS, TUNING, Source
from fastac.sweep.results import Row

PAGE, PICTURE = "trade.html", "trade_{}.png"
PAPER_CYCLES = EDGE["image_to_force_cycles_at_150_mhz"]
PAPER_ERRORS = {
    "depth_mae_mm": EDGE["integer"]["depth_mae_mm"],
    "force_z_mae_n": EDGE["integer"]["force_mae_n"],
}
PAPER_LABEL = "the paper: its own sensor and board"
SHOWN = ("latency_cycles", "dsp", "lut", "ramb36", "energy_uj")


@dataclass(frozen=True)
class Trade:
    """What is shown: the results files, their distinct points, and the marked scenes' rows by name."""

    sources: Sequence[Source]
    rows: Sequence[Row]
    marked: dict[str, Row] = field(default_factory=dict)

    @property
    def errors(self) -> list[str]:
        return [name for name in ERRORS if any(name in row.metrics for row in self.rows)]

    @property
    def confirmed(self) -> dict[str, dict]:
        found = {}
        for source in self.sources:
            found |= source.results.confirmations()
        return {row.key: found[row.key] for row in self.rows if row.key in found}


def named(row: Row) -> str:
    """The values chosen along the sweep's axes for a row, as text."""
    return ", ".join(f"{key.split('.')[-1]} {_value(value)}" for key, value in row.axes.items())


def _value(value) -> str:
    return "+".join(map(str, value)) if isinstance(value, list) else str(value)


def _cells(row: Row, names: Sequence[str]) -> list[str]:
    return [number(row.metrics[name]) if name in row.metrics else "" for name in names]


def faster_table(shown: Trade, error: str) -> Table:
    """The least error at each doubling of the speed."""
    rows, before = [], None
    for ratio, row in front.faster(shown.rows, error):
        value = row.metrics[error]
        change = "" if before is None else f"{100 * (value / before - 1):+.1f}%"
        cells = [f"{ratio:.1f}×", number(value), change, *_cells(row, SHOWN)]
        rows.append([*cells, f"{row.scene['sensor']['width_px']} px, {named(row)}"])
        before = value
    return Table(
        f"The price of speed: {ERRORS[error]}",
        ["speed", error, "change", *SHOWN, "design"],
        rows,
        "Each line has the least error of all designs with at most 1/2, 1/4, … of the first line's cycles.",
    )


def keys_table(source: Source) -> Table:
    """The rows that differ from the base scene in one key only, key by key."""
    present = [name for name in ERRORS if any(name in row.metrics for row in source.done)]
    rows = [
        [key, _value(value), *_cells(row, (*present, *SHOWN))]
        for key, values in sorted(front.one_at_a_time(source).items())
        for value, row in values
    ]
    name = source.facts["scene"]["name"]
    return Table(
        f"One key at a time: scene {name}, {source.results.path.name}",
        ["key", "value", *present, *SHOWN],
        rows,
        f"All else is as in scenes/{name}.toml; the force is fitted anew for each line.",
    )


def tuning_table(source: Source) -> Table:
    """Errors after bit-true fine-tuning and after post-training quantisation."""
    present = [name for name in ERRORS if any(name in row.metrics for row in source.done)]
    rows = []
    for values, row in front.tuned(source):
        epochs, weights, rate = (values[key] for key in TUNING)
        how = f"bit-true fine-tuning, {epochs} epochs" + (f", weights too, rate {rate}" if weights else "")
        bits = [str(values[key]) for key in front.BITS]
        floats = [number(row.metrics[f"float_{name}"]) for name in present if f"float_{name}" in row.metrics]
        rows.append([*bits[:2], bits[2], how if epochs else "post-training", *_cells(row, present), *floats])
    return Table(
        "Bit-true fine-tuning against post-training quantisation",
        ["weights", "activations", "last layer", "how", *present, *(f"float_{name}" for name in present)],
        rows,
        "Bits of weights and activations; the last layer's weights have bits of their own.",
    )


def confirmed_table(shown: Trade) -> Table:
    """What RTL simulations of designs found."""
    rows = []
    by_key = {row.key: row for row in shown.rows}
    for key, content in shown.confirmed.items():
        stated = "; ".join(f"{name} {value:,}" for name, value in content["cycles_counted"].items())
        verdict = "exact" if content["is_exact"] else "DIFFERENT"
        rows.append(
            [
                key[:12],
                verdict,
                f"{content['mismatches']:,} of {content['values_compared']:,}",
                stated,
                named(by_key[key]),
            ]
        )
    return Table(
        "Designs confirmed in RTL", ["point", "verdict", "mismatches", "cycles counted", "design"], rows
    )


def failures_table(sources: Sequence[Source]) -> Table:
    """The designs without results, and why."""
    rows = [[row.status, named(row), row.error] for s in sources for row in s.rows if row.status != "done"]
    return Table("Designs that are infeasible or failed", ["", "design", "why"], rows)


def tables(shown: Trade) -> list[Table]:
    """All tables that have rows."""
    found = [faster_table(shown, error) for error in shown.errors if error != "normal_mae_deg"]
    found += [table(source) for source in shown.sources for table in (tuning_table, keys_table)]
    found += [confirmed_table(shown), failures_table(shown.sources)]
    return [table for table in found if table.rows]


def _hover(row: Row) -> str:
    sensor = row.scene["sensor"]
    lines = [f"<b>{row.scene['name']}</b>, {sensor['width_px']} px, {sensor['channels']}"]
    lines += [f"{key} = {_value(value)}" for key, value in row.axes.items()]
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
        for name, row in shown.marked.items():
            if error in row.metrics:
                add([row], f"scene {name}", mode="markers", marker={"size": 14, "symbol": "star"})
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
        found.update_xaxes(title_text=label, type=scale(rows, cost), row=1, col=k)
    found.update_yaxes(title_text=ERRORS[error], type="log", row=1, col=1)
    found.update_yaxes(type="log")
    found.update_layout(
        height=520, margin={"t": 20}, legend={"orientation": "h", "y": -0.2}, template="simple_white"
    )
    return found


def picture(shown: Trade, error: str, path: Path) -> None:
    """The same plot as a PNG file."""
    plot = Figure(figsize=(5 * len(COSTS), 4.2))
    panels = plot.subplots(1, len(COSTS), sharey=True)
    rows = front.with_metrics(shown.rows, (error,))
    for panel, (cost, label) in zip(panels, COSTS.items(), strict=True):

        def at(rows: Sequence[Row], over=cost) -> tuple[list[float], list[float]]:
            return [row.metrics[over] for row in rows], [row.metrics[error] for row in rows]

        panel.semilogy(*at(rows), ".", color="#9aa7b5", label="designs")
        panel.step(*at(front.front(rows, (error, cost))), "o-", where="post", markersize=4, label="front")
        confirmed = [row for row in rows if row.key in shown.confirmed]
        if confirmed:
            panel.plot(
                *at(confirmed), "o", color="#2a8f4e", markersize=9, fillstyle="none", label="confirmed in RTL"
            )
        for name, row in shown.marked.items():
            if error in row.metrics:
                panel.plot(*at([row]), "*", markersize=12, label=f"scene {name}")
        if cost == "latency_cycles" and error in PAPER_ERRORS:
            panel.plot(PAPER_CYCLES, PAPER_ERRORS[error], "D", color="#c0392b", label=PAPER_LABEL)
        panel.set_xscale(scale(rows, cost))
        panel.set_xlabel(label)
        panel.grid(alpha=0.3, which="both")
    panels[0].set_ylabel(ERRORS[error])
    panels[0].legend(fontsize=7)
    save_png(plot, path)


def write(shown: Trade, folder: Path) -> list[Path]:
    """Write the page and its pictures; returns the files. The page holds Plotly's code and all data."""
    written, figures = [], []
    for error in shown.errors:
        path = folder / PICTURE.format(error)
        picture(shown, error, path)
        written.append(path)
        script = "inline" if not figures else False
        html = figure(shown, error).to_html(full_html=False, include_plotlyjs=script)
        figures.append((ERRORS[error], html))
    origins = {
        name: text for source in shown.sources for name, text in source.facts.get("origins", {}).items()
    }
    simulated = {row.scene["sensor"]["source"] for row in shown.rows}
    page = render(
        "sweep/trade.html.j2",
        figures=figures,
        tables=tables(shown),
        origins=origins,
        sources=shown.sources,
        frames_are=" and ".join(sorted(simulated)),
        paper={"cycles": PAPER_CYCLES, "label": PAPER_LABEL},
    )
    write_text(folder / PAGE, page)
    return [folder / PAGE, *written]
