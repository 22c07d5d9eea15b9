"""Commands that explore designs: sweeps, the trade, the scope of scenes, the chips that hold them."""

from pathlib import Path

import click

from fastac.cli.common import INPUT, OUTPUT_FILE, OUTPUT_FOLDER, Rates, output_option, progress_option
from fastac.report.tables import text_table
from fastac.scenes import schema as scenes


@click.command()
@click.argument("spec", type=INPUT)
@output_option("SQLite file of the results.", OUTPUT_FILE, "build/sweep/SPEC.sqlite")
@click.option(
    "--store",
    type=INPUT,
    default=Path("build/store"),
    show_default=True,
    help="Folder of the step store: datasets and trained models, shared with builds and other sweeps.",
)
@click.option("--workers", type=click.IntRange(1), help="Local processes. [default: one for each core]")
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Run on the Dask cluster of this scheduler, such as tcp://host:8786; its workers need one thread"
    " each and the same files.",
)
@progress_option
def sweep(spec, output, store, workers, scheduler, progress):
    """Design-space exploration: measure errors, cycles, resources and energy of all designs in SPEC.

    SPEC is a TOML file: `scene`, a base scene; [axes], scene keys with lists of values, such as
    "numbers.data_bits" = [18, 22, 26] (several tables with [[axes]]; keys with commas between them move
    together; "unset" gives a key its default); `method`, "grid" or "optuna" with `trials`, `seed` and
    `objectives`; `frames` and `split` to evaluate on; `data`, a dataset, for recorded sensors. Paths are
    relative to SPEC.

    Errors are those of the bit-exact emulator on held-out frames; cycles follow from the design's formulas;
    resources and energy are estimates. Nothing is simulated in RTL: `fastac trade --confirm` does that.
    Models are trained once for all points that share them. A design that cannot be built is recorded with its
    error. Results and models are kept, so an interrupted sweep resumes.

    \b
    Example: fastac sweep sweeps/quantisation.toml --workers 2
    """
    from fastac.sweep.run import explore

    if scheduler and workers:
        raise click.UsageError("--workers is of local processes: give it or --scheduler")
    output = output or Path("build/sweep") / f"{spec.stem}.sqlite"
    counts = explore(spec, output, store=store, workers=workers, scheduler=scheduler, progress=progress)
    click.echo(f"{output}: " + ", ".join(f"{count} {name}" for name, count in counts.items()))


MARKED = ("paper", "fast", "force", "small")
"""Scenes of this repository that `trade` marks where it finds them."""


@click.command()
@click.argument("results", type=INPUT, nargs=-1, required=True)
@output_option(
    "Folder for trade.html, its pictures, and what --confirm builds.", OUTPUT_FOLDER, "build/trade"
)
@click.option(
    "--mark",
    "marked",
    type=INPUT,
    multiple=True,
    metavar="SCENE",
    help="Mark the design of this scene; repeatable. [default: paper, fast, force and small in scenes/]",
)
@click.option(
    "--pick",
    metavar="LIMITS",
    help='Write the scene of the best design within limits such as "depth_mae_mm<0.03, dsp<220".',
)
@click.option(
    "--by",
    default="latency_cycles,energy_uj",
    show_default=True,
    metavar="METRICS",
    help="Order of --pick: smallest first metric, among equals the smallest next one.",
)
@click.option(
    "--scene",
    "scene_file",
    type=OUTPUT_FILE,
    help="File that --pick writes. [default: picked.toml in the folder]",
)
@click.option(
    "--confirm",
    type=click.IntRange(1),
    metavar="N",
    help="Build N random designs of the Pareto fronts and compare their RTL with the integer model.",
)
@click.option(
    "--seed",
    type=click.IntRange(0),
    default=1,
    show_default=True,
    help="Seed of the random choice of --confirm.",
)
@progress_option
def trade(results, output, marked, pick, by, scene_file, confirm, seed, progress):
    """Show how accuracy falls as speed rises: the Pareto fronts of RESULTS, files of `fastac sweep`.

    Writes an interactive page, with a table of the accuracy that each doubling of the speed costs, and
    pictures of the fronts. --pick writes the scene of the best design within limits, ready for `fastac
    build`; limits are metrics with < <= > >= and a number, separated by commas. An unknown metric is answered
    with a list of all.

    --confirm takes N random designs of the fronts over an error, cycles, DSP and energy, builds their
    Verilog and sends held-out frames through it: every value must equal the integer model's, and every
    latency the stated one. Findings are kept in RESULTS and not simulated again.

    \b
    Example: fastac trade build/sweep/quantisation.sqlite --pick "depth_mae_mm<0.03, dsp<220"
    """
    from fastac.sweep import front as trading
    from fastac.sweep import page

    sources = [trading.read(path) for path in results]
    designs = trading.distinct(sources)
    rows = [row for _, row in designs]
    different = 0
    if confirm:
        from fastac.sweep import confirm as trade_confirm

        best = {row.key for row in trading.best_designs(rows)}
        chosen = [(source, row) for source, row in designs if row.key in best]
        click.echo(f"fronts over an error, cycles, DSP and energy: {len(chosen)} of {len(designs)} designs")

        def tell(row, content):
            verdict = "exact" if content["is_exact"] else f"DIFFERENT: {content['first_mismatch']}"
            counts = f"{content['mismatches']} mismatches of {content['values_compared']:,}"
            click.echo(f"{row.key[:12]} {verdict}: {counts}, cycles {content['cycles_counted']}")

        found = trade_confirm.run(
            chosen, confirm, seed, (output or Path("build/trade")) / "rtl", tell, progress=progress
        )
        different = sum(not content["is_exact"] for content in found)
    output = output or Path("build/trade")
    paths = marked or [path for name in MARKED if (path := Path("scenes") / f"{name}.toml").exists()]
    stars = {s.name: row for s in map(scenes.load, paths) for row in rows if trading.is_scene(row, s)}
    shown = page.Trade(sources, rows, stars)
    for table in page.tables(shown):
        click.echo(table.text)
    if pick:
        by_names = [name.strip() for name in by.split(",")]
        best = trading.pick(rows, pick, by_names)
        path = scene_file or output / "picked.toml"
        trading.write_scene(best, path, f"fastac trade --pick {pick!r} --by {by}")
        click.echo(f"{path}: {page.named(best)}")
        shown_names = sorted({*by_names, *trading.asked(pick)})
        click.echo(text_table(["metric", "value"], [[n, f"{best.metrics[n]:.6g}"] for n in shown_names]))
    for path in page.write(shown, output):
        click.echo(path)
    if different:
        raise click.ClickException(f"{different} designs differ in RTL")


@click.command()
@click.argument("scene_files", type=INPUT, nargs=-1, required=True, metavar="SCENE...")
@click.option(
    "--rates",
    type=Rates(),
    default="60,240,1000",
    show_default=True,
    help="Frames a second that the camera sends.",
)
@click.option(
    "--clock-mhz",
    type=click.FloatRange(min=0, min_open=True),
    default=100,
    show_default=True,
    help="The clock of the hardware, an assumption.",
)
def chips(scene_files, rates, clock_mhz):
    """Show which chip holds which SCENE at which rate of the camera.

    Prints a Markdown table with a row for each scene and part, and a column for each rate: pixels a clock,
    the fewest that never make the camera wait, and the shares of the part that such hardware takes. Area is
    estimated from word widths, with random weights; nothing is trained or elaborated.

    \b
    Example: fastac chips scenes/small.toml scenes/paper.toml --rates 60,240
    """
    from fastac.report import chips as counting

    click.echo(counting.table([scenes.load(path) for path in scene_files], rates, clock_mhz))


@click.command()
@click.argument("scene_files", type=INPUT, nargs=-1, required=True, metavar="SCENE...")
@click.option(
    "--builds",
    type=INPUT,
    default=Path("build"),
    show_default=True,
    help="Folder of the builds whose wall times are shown.",
)
def scope(scene_files, builds):
    """Compare scenes: which steps, stages and labels each SCENE needs, and its area and build times.

    Prints a Markdown table with a column for each scene. Area is estimated from word widths, with random
    weights; nothing is trained or elaborated. Wall times are those of finished builds.

    \b
    Example: fastac scope scenes/paper.toml scenes/fast.toml
    """
    from fastac.report import scope as scoping

    found = [scoping.Scope(s, builds / s.name) for s in map(scenes.load, scene_files)]
    click.echo(scoping.table(found))
