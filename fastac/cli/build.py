"""Commands that do everything in order, and tell the result."""

import json
from pathlib import Path

import click

from fastac.cli.common import (
    INPUT,
    announce,
    build_folder,
    load_bundle,
    output_option,
    progress_option,
    run_build,
)
from fastac.report.tables import text_table
from fastac.scenes import schema as scenes


def print_summary(folder: Path) -> None:
    from fastac.report.content import summary_rows

    report = json.loads((folder / "report.json").read_text())
    rows = [[what, ours, paper] for what, ours, paper, _ in summary_rows(report)]
    click.echo(text_table(["", "here", "paper"], rows))
    click.echo(f"{folder / 'report.html'}")


@click.command()
@click.argument("scene", type=INPUT)
@click.option("--data", type=INPUT, help="Recorded dataset; without it the virtual fingertip is pressed.")
@output_option("build/SCENE", "The build folder.")
@progress_option
def build(scene, data, output, progress):
    """From SCENE to frames, trained integers, Verilog, its proof on held-out frames, and the report.

    Steps whose inputs have not changed are kept; an interrupted build resumes where it stopped.
    """
    scene = scenes.load(scene)
    folder = build_folder(scene, output)
    run_build(scene, folder, data, progress, until=None)
    print_summary(folder)
    check_mismatches(folder)


def check_mismatches(folder: Path) -> None:
    """Raise ClickException where the build's Verilog differs from its integer model."""
    mismatches = json.loads((folder / "report.json").read_text())["rtl_vs_integer"]["mismatches"]
    if mismatches:
        raise click.ClickException(f"{mismatches} mismatches between Verilog and integer model")


@click.command()
@click.argument("scene", type=INPUT, default=Path("scenes/fingertip.toml"))
@click.option("--data", type=INPUT, help="Recorded dataset; without it the virtual fingertip is pressed.")
@click.option("--build", "folder", type=INPUT, help="The build's folder. [default: build/SCENE]")
@click.option(
    "-o",
    "--output",
    type=INPUT,
    default=Path("build/reproduce"),
    show_default=True,
    help="Folder for reproduce.json, reproduce.html and what they are made from.",
)
@progress_option
def reproduce(scene, data, folder, output, progress):
    """The paper's tables of SCENE, beside the paper's own figures, and whether the goals are reached.

    Builds the scene first, then compares RGB with RGB-NIR and depth with and without prior, trains
    HyperForce's six forms, times each stage, and finds by experiments what limits the figures. What SCENE
    has no use for is left out, and said. Everything is kept: interrupted, run it again. Without SCENE it is
    scenes/fingertip.toml.
    """
    from fastac.flow.build import Build
    from fastac.studies.reproduce import page
    from fastac.studies.reproduce import run as reproduction

    scene = scenes.load(scene)
    build = Build(scene, build_folder(scene, folder), data, progress)
    content = reproduction.run(build, output, announce)
    click.echo(page.text(content, reproduction.SECTIONS))
    click.echo(f"{output / reproduction.PAGE}")
    check_mismatches(build.folder)


@click.command()
@click.argument("folder", type=INPUT)
@click.option("--data", type=INPUT, help="The dataset of the build. [default: FOLDER/data.h5]")
@click.option(
    "--picture", type=INPUT, help="Draw a frame, what is found in it and the cycles: PNG, SVG or PDF."
)
def report(folder, data, picture):
    """Write report.json and report.html of the build in FOLDER again, and print the summary."""
    from fastac.flow.frames import read
    from fastac.report import page as reporting
    from fastac.report import picture as one_picture

    model = load_bundle(folder)
    samples = read(data or folder / "data.h5", model.scene)
    reporting.write(folder, model, samples)
    if picture:
        one_picture.write(picture, model, samples, json.loads((folder / "report.json").read_text()))
    print_summary(folder)
