"""The trade of speed against accuracy as an interactive page, as pictures, and as tables."""

from collections.abc import Sequence
from pathlib import Path

from fastac.report.headline import Headline
from fastac.report.plotly_look import config
from fastac.report.render import render
from fastac.report.tables import Table, number
from fastac.scenes.pace import PACES, Pace
from fastac.scenes.schema import Scene
from fastac.store.files import write_text
from fastac.sweep import front
from fastac.sweep.front import COSTS, ERRORS, TUNING, Source
from fastac.sweep.plots import figure, picture
from fastac.sweep.results import Row
from fastac.sweep.seeds import headlines_table, seeds_table
from fastac.sweep.shown import PAPER_CYCLES, PAPER_LABEL, SHOWN, Trade, named, value_text

PAGE, PICTURE = "trade.html", "trade_{}.png"
CONFIG = config("toImage", "zoom2d", "pan2d", "resetScale2d")


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


def paces_table(shown: Trade) -> Table:
    """By pace, how many designs are on a front, and what the best of them have."""
    best = {row.key for row in front.best_designs(shown.rows)} if shown.errors else set()
    by_pace: dict[Pace, list[Row]] = {}
    for row in shown.rows:
        by_pace.setdefault(Scene.model_validate(row.scene).pace, []).append(row)
    names = [*shown.errors, "last_pixel_to_force_cycles", *SHOWN]
    rows = []
    for pace in sorted(by_pace, key=PACES.index):
        on_front = [row for row in by_pace[pace] if row.key in best]
        known = [[row.metrics[name] for row in on_front if name in row.metrics] for name in names]
        cells = [number(min(values)) if values else "" for values in known]
        rows.append([str(pace.value), f"{len(on_front)} of {len(by_pace[pace])}", *cells])
    return Table(
        "On the fronts, by pixels a clock",
        ["pixels a clock", "designs", *names],
        rows,
        "Designs on the front over an error and all costs; in each column the least that one of them has.",
    )


def keys_table(source: Source) -> Table:
    """The rows that differ from the base scene in one key only, key by key."""
    present = [name for name in ERRORS if any(name in row.metrics for row in source.done)]
    rows = [
        [key, value_text(value), *_cells(row, (*present, *SHOWN))]
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
    found.append(paces_table(shown))
    of_each = (seeds_table, headlines_table, tuning_table, keys_table)
    found += [table(source) for source in shown.sources for table in of_each]
    found += [confirmed_table(shown), failures_table(shown.sources)]
    return [table for table in found if table.rows]


def headlines(shown: Trade) -> list[Headline]:
    """How many designs there are, and the least of each error and cost, with the design that has it."""
    found = [Headline("designs measured", f"{len(shown.rows):,}", f"{len(shown.confirmed)} confirmed in RTL")]
    for name, label in {**{error: ERRORS[error] for error in shown.errors}, **COSTS}.items():
        known = front.with_metrics(shown.rows, (name, "latency_cycles"))
        if known:
            best = min(known, key=lambda row: (row.metrics[name], row.metrics["latency_cycles"]))
            value = number(best.metrics[name])
            found.append(Headline(f"least: {label}", value, named(best) or best.scene["name"]))
    return found


def write(shown: Trade, folder: Path) -> list[Path]:
    """Write the page and its pictures; returns the files. The page holds Plotly's code and all data."""
    written, figures = [], []
    for error in shown.errors:
        path = folder / PICTURE.format(error)
        picture(shown, error, path)
        written.append(path)
        script = "inline" if not figures else False
        html = figure(shown, error).to_html(full_html=False, include_plotlyjs=script, config=CONFIG)
        figures.append((ERRORS[error], html))
    origins = {
        name: text for source in shown.sources for name, text in source.facts.get("origins", {}).items()
    }
    simulated = {row.scene["sensor"]["source"] for row in shown.rows}
    page = render(
        "sweep/trade.html.j2",
        figures=figures,
        headlines=headlines(shown),
        tables=tables(shown),
        origins=origins,
        sources=shown.sources,
        frames_are=" and ".join(sorted(simulated)),
        paper={"cycles": PAPER_CYCLES, "label": PAPER_LABEL},
    )
    write_text(folder / PAGE, page)
    return [folder / PAGE, *written]
