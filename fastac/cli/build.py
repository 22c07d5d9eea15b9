"""Commands that run all steps of a build and print its results."""

import json
from pathlib import Path

import click

from fastac.cli.common import (
    INPUT,
    OUTPUT_FILE,
    OUTPUT_FOLDER,
    announce,
    build_folder,
    load_bundle,
    load_scene,
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
@click.option(
    "--data", type=INPUT, help="Dataset of a recorded sensor. [default: simulate the virtual fingertip]"
)
@output_option("The build folder.", OUTPUT_FOLDER, "build/SCENE")
@click.option("--why", is_flag=True, help="Only say of each step whether it would run, and why.")
@progress_option
def build(scene, data, output, why, progress):
    """Run every step of SCENE: dataset, training, Verilog, its simulation on held-out frames, report.

    Steps whose inputs have not changed are kept; an interrupted build resumes where it stopped. Ends with an
    error if any simulated value differs from the integer model.

    \b
    Example: fastac build scenes/paper.toml
    """
    scene = load_scene(scene, data)
    folder = build_folder(scene, output)
    if why:
        from fastac.flow.build import Build

        for name, reason in Build(scene, folder, data, progress).reasons().items():
            click.echo(f"{name:10s} {reason}")
        return
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
@click.option(
    "--data", type=INPUT, help="Dataset of a recorded sensor. [default: simulate the virtual fingertip]"
)
@click.option("--build", "folder", type=INPUT, help="Build folder of SCENE. [default: build/SCENE]")
@output_option(
    "Folder for reproduce.json, reproduce.html and their pictures.", OUTPUT_FOLDER, "build/reproduce"
)
@progress_option
def reproduce(scene, data, folder, output, progress):
    """Repeat the paper's experiments on SCENE and print its tables beside the paper's figures.

    Builds the scene first, then compares RGB with RGB-NIR and depth with and without the boundary prior,
    trains the six forms of HyperForce, times each stage and measures what limits the accuracy. Sections that
    do not apply to SCENE are left out with the reason. Finished sections are kept, so an interrupted run
    resumes. [default SCENE: scenes/fingertip.toml]

    \b
    Example: fastac reproduce scenes/fingertip.toml
    """
    from fastac.flow.build import Build
    from fastac.studies.reproduce import page
    from fastac.studies.reproduce import run as reproduction

    scene, output = scenes.load(scene), output or Path("build/reproduce")
    build = Build(scene, build_folder(scene, folder), data, progress)
    content = reproduction.run(build, output, announce)
    click.echo(page.text(content, reproduction.SECTIONS))
    click.echo(f"{output / reproduction.PAGE}")
    check_mismatches(build.folder)


@click.command()
@click.argument("folder", type=INPUT)
@click.option("--data", type=INPUT, help="Dataset of the build. [default: FOLDER/data.h5]")
@click.option(
    "--picture",
    type=OUTPUT_FILE,
    metavar="FILE",
    help="Also draw a frame, the outputs found in it and the hardware's cycles: PNG, SVG or PDF.",
)
def report(folder, data, picture):
    """Write report.json and report.html of the finished build in FOLDER again, and print the summary.

    Needed after `fastac synth`, whose counts then replace the estimates.

    \b
    Example: fastac report build/paper
    """
    from fastac.flow.frames import read
    from fastac.report import page as reporting
    from fastac.report import picture as one_picture

    model = load_bundle(folder)
    samples = read(data or folder / "data.h5", model.scene)
    reporting.write(folder, model, samples)
    if picture:
        one_picture.write(picture, model, samples, json.loads((folder / "report.json").read_text()))
    print_summary(folder)


@click.command()
@click.argument("a", type=INPUT)
@click.argument("b", type=INPUT)
@output_option("The page.", OUTPUT_FILE, "build/compare/A-B.html, by the names of the folders")
@click.option("--force", is_flag=True, help="Replace the page if it exists.")
def compare(a, b, output, force):
    """Compare the finished builds in the folders A and B: scenes, errors, cycles, resources, energy.

    Prints the keys in which their scenes differ, and each figure of both with the relative difference of B
    from A; writes a page with the same and with the stages of both on one scale. Nothing is built or
    simulated: the figures are those of the folders' report.json.

    \b
    Example: fastac compare build/paper build/fast
    """
    from fastac.report import comparison

    shown = comparison.read((a, b))
    path = output or Path("build/compare") / f"{shown.a.name}-{shown.b.name}.html"
    if path.exists() and not force:
        raise click.ClickException(f"{path}: exists already; --force replaces it")
    click.echo(shown.text)
    comparison.write(shown, path)
    click.echo(f"\n{path}")
