"""Commands of the two simulated experiments over time: vibration and grasp."""

from pathlib import Path

import click

from fastac.cli.common import INPUT, OUTPUT_FOLDER, load_bundle, output_option, progress_option, store_option
from fastac.report.tables import Table


def _announce(tables: list[Table], output: Path, name: str) -> None:
    for table in tables:
        click.echo(f"{table.text}\n{table.note}")
    click.echo(f"written: {output / name}.json, .png")


@click.command()
@click.argument("bundle", type=INPUT)
@click.option("--seconds", type=float, default=1.0, show_default=True, help="Duration of each vibration, s.")
@click.option(
    "--load-n", type=float, default=None, help="Mean load, N. [default: 2/3 of the scene's largest]"
)
@click.option(
    "--amplitude-n",
    type=float,
    default=None,
    help="Amplitude of the load, N. [default: 4/15 of the scene's largest]",
)
@output_option("Folder for vibration.json and .png.", OUTPUT_FOLDER, "build/SCENE/vibration")
@store_option("finite-element compliances")
@progress_option
def vibration(bundle, seconds, load_n, amplitude_n, output, store, progress):
    """Vibrate a ball on the virtual sensor at 50, 70 and 100 Hz and measure F_z over time with BUNDLE.

    A 240 Hz camera records it. Pipelines with the paper's output rates (104, 156 and 240 Hz) and with this
    design's own rate take the newest frame whenever they are free and drop the others. The largest peak of
    each spectrum is compared with the input frequency and with the alias that the rate implies. All
    of it is simulated.

    \b
    Example: fastac vibration build/paper
    """
    from fastac.studies.demos import vibration as experiment

    bundle = load_bundle(bundle)
    output = output or Path("build") / bundle.scene.name / "vibration"
    what = experiment.Vibration(seconds, load_n, amplitude_n)
    found = experiment.run(bundle, output, vibration=what, store=store, progress=progress)
    _announce(experiment.tables(found), output, "vibration")


@click.command()
@click.argument("bundle", type=INPUT)
@click.option(
    "--grip-n",
    type=float,
    default=None,
    help="Force of each finger at the start, N. [default: a third of the scene's largest]",
)
@click.option(
    "--step-deg",
    type=float,
    default=0.05,
    show_default=True,
    help="Angle by which the feedback closes the fingers at a time.",
)
@click.option(
    "--stable",
    type=float,
    default=0.5,
    show_default=True,
    help="Ratio μ_s that is held to be safe, as a share of the ratio F_s/F_n at which the bottle slipped.",
)
@click.option(
    "--margin",
    type=float,
    default=0.1,
    show_default=True,
    help="Margin d above μ_s before the fingers close, as a share of the same.",
)
@output_option("Folder for grasp.json and .png.", OUTPUT_FOLDER, "build/SCENE/grasp")
@store_option("finite-element compliances")
@progress_option
def grasp(bundle, grip_n, step_deg, stable, margin, output, store, progress):
    """Hold a bottle between two virtual fingertips, push it down, and report whether it slips.

    Done with a fixed angle between the fingers, and with the paper's feedback, which closes them whenever the
    forces that BUNDLE measures have F_s/F_n > μ_s + d; if BUNDLE's scene has the output slip, also with a
    feedback that closes them whenever a frame is flagged as slipping and knows neither μ nor force. Whether
    the bottle slips follows from the simulated contact and its friction. BUNDLE's scene needs the output
    force_xyz, finite elements and friction. All of it is simulated.

    \b
    Example: fastac grasp build/grasp
    """
    from fastac.studies.demos import grasp as experiment
    from fastac.studies.demos.bottle import Grasp

    bundle = load_bundle(bundle)
    output = output or Path("build") / bundle.scene.name / "grasp"
    what = Grasp(grip_n=grip_n, step_deg=step_deg, stable_share=stable, margin_share=margin)
    found = experiment.run(bundle, output, grasp=what, store=store, progress=progress)
    _announce(experiment.tables(found), output, "grasp")
