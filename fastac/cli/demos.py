"""Commands of the experiments in time: vibration, grasp."""

from pathlib import Path

import click

from fastac.cli.common import INPUT, load_bundle, output_option, progress_option, store_option
from fastac.report.tables import Table


def _announce(tables: list[Table], output: Path, name: str) -> None:
    for table in tables:
        click.echo(f"{table.text}\n{table.note}")
    click.echo(f"written: {output / name}.json, .png")


@click.command()
@click.argument("bundle", type=INPUT)
@click.option("--seconds", type=float, default=1.0, show_default=True, help="Of each vibration.")
@click.option("--load-n", type=float, default=None, help="Mean load. [default: 2/3 of the scene's largest]")
@click.option(
    "--amplitude-n", type=float, default=None, help="Of the load. [default: 4/15 of the scene's largest]"
)
@output_option("build/SCENE/vibration", "Folder for JSON and picture.")
@store_option("finite-element compliances")
@progress_option
def vibration(bundle, seconds, load_n, amplitude_n, output, store, progress):
    """Vibrate a ball on the virtual sensor at 50, 70 and 100 Hz; BUNDLE's integers find F_z(t).

    A camera of 240 Hz sees it. Pipelines of the paper's output rates, 104, 156 and 240 Hz, and this design at
    its own take the newest frame whenever they are free, and drop what comes meanwhile. The dominant peak of
    each DFT is compared with the input and with the alias that is to be expected. All of it is simulated.
    """
    from fastac.studies.demos import vibration as experiment

    bundle = load_bundle(bundle)
    output = output or Path("build") / bundle.scene.name / "vibration"
    what = experiment.Vibration(seconds, load_n, amplitude_n)
    found = experiment.run(bundle, output, vibration=what, store=store, progress=progress)
    _announce(experiment.tables(found), output, "vibration")


@click.command()
@click.argument("bundle", type=INPUT)
@click.option("--grip-n", type=float, default=None, help="A finger's first force. [default: a third]")
@click.option("--step-deg", type=float, default=0.05, show_default=True, help="By which the fingers close.")
@click.option("--stable", type=float, default=0.5, show_default=True, help="μ_s over the μ found at a slip.")
@click.option("--margin", type=float, default=0.1, show_default=True, help="d over the same.")
@output_option("build/SCENE/grasp", "Folder for JSON and picture.")
@store_option("finite-element compliances")
@progress_option
def grasp(bundle, grip_n, step_deg, stable, margin, output, store, progress):
    """Hold a bottle between virtual fingertips, push it down, and see whether it slips.

    Twice: with the angle between the fingers as it was, and with the paper's feedback, which makes it smaller
    whenever the forces that BUNDLE's integers find have μ = F_s/F_n > μ_s + d. The slip is a result of the
    contact's friction. BUNDLE's scene needs force_xyz, finite elements and friction. All of it is simulated.
    """
    from fastac.studies.demos import grasp as experiment
    from fastac.studies.demos.bottle import Grasp

    bundle = load_bundle(bundle)
    output = output or Path("build") / bundle.scene.name / "grasp"
    what = Grasp(grip_n=grip_n, step_deg=step_deg, stable_share=stable, margin_share=margin)
    found = experiment.run(bundle, output, grasp=what, store=store, progress=progress)
    _announce(experiment.tables(found), output, "grasp")
