"""Studies: what the arithmetic costs, how a design fares at its extremes, what the paper compares."""

from pathlib import Path

import click

from fastac.cli.common import INPUT, Group, load_bundle, output_option, progress_option, store_option


@click.group(cls=Group)
def study():
    """Studies of a finished build: equivalences, extremes, long runs, the paper's ablation."""


@study.command("force-ablation")
@click.argument("origin", metavar="SCENE|BUILD", type=INPUT)
@click.option("--data", type=INPUT, required=True, help="Dataset with forces along x, y and z.")
@click.option(
    "--displacements",
    type=click.Choice(["both", "true", "found"]),
    default="both",
    show_default=True,
    help="True ones, those found in the frames, or both.",
)
@output_option("build/SCENE/force_ablation", "Folder for JSON, plot and runs.")
@store_option("processed frames")
@progress_option
def force_ablation(origin, data, displacements, output, store, progress):
    """HyperForce's six forms, trained and compared with the paper's table.

    SCENE is a TOML file: the pixel network is trained first where displacements are to be found. BUILD is a
    build folder or a bundle, whose network finds them. Interrupted, run it again: it goes on.
    """
    from fastac.scenes import schema
    from fastac.studies.reproduce import force_ablation as ablation

    kinds = ("true", "found") if displacements == "both" else (displacements,)
    name = load_bundle(origin).scene.name if origin.is_dir() else schema.load(origin).name
    output = output or Path("build") / name / "force_ablation"
    click.echo(ablation.table(ablation.run(origin, data, output, kinds, store, progress=progress)))
    click.echo(f"written: {output}/force_ablation.json, .png")


@study.command()
@click.argument("folders", metavar="BUILD_FOLDER...", type=INPUT, nargs=-1, required=True)
@progress_option
def identities(folders, progress):
    """What fixed point costs in the three identities of docs/mathematics.md, on held-out frames."""
    from fastac.studies.equivalence import identities as equivalence

    for folder in folders:
        for line in equivalence.measure(folder, progress=progress):
            click.echo(line)


@study.command()
@click.argument("folder", metavar="BUILD_FOLDER", type=INPUT)
@click.option(
    "--rtl/--no-rtl",
    default=True,
    help="Send the worst cases through the stages' hardware too, in Verilator.",
)
@progress_option
def extremes(folder, rtl, progress):
    """How a build folder's bundle fares at the extremes; writes extremes.json and extremes.png there."""
    from fastac.studies.robustness import extremes as robustness

    for line in robustness.measure(folder, rtl=rtl, progress=progress):
        click.echo(line)


@study.command()
@click.argument("folder", metavar="BUILD_FOLDER", type=INPUT)
@click.option(
    "--frames", type=click.IntRange(1), default=10_000, show_default=True, help="Through the emulator."
)
@click.option(
    "--rtl-frames",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    help="Through the simulated hardware, whose Verilog must be in BUILD_FOLDER.",
)
@progress_option
def stability(folder, frames, rtl_frames, progress):
    """Consecutive frames of a build folder's dataset, one of them recurring; writes stability.json there."""
    from fastac.studies.robustness import stability as robustness

    for line in robustness.measure(folder, frames=frames, rtl_frames=rtl_frames, progress=progress):
        click.echo(line)
