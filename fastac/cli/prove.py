"""Commands of the verification campaigns: proofs, mutants, other simulators, faults, and their page."""

from pathlib import Path

import click

from fastac.cli.common import INPUT, OUTPUT_FILE, OUTPUT_FOLDER, Group, output_option, progress_option
from fastac.store.evidence import FOLDER


@click.group(cls=Group)
def prove():
    """Campaigns that verify the hardware; each keeps its result in build/evidence/."""


@prove.command()
@click.argument("names", metavar="[PROOF]...", nargs=-1)
@click.option("--quick", is_flag=True, help="Only those that take a few seconds.")
@click.option("--jobs", type=click.IntRange(0), default=0, help="Solvers side by side. [default: one a core]")
def formal(names, quick, jobs):
    """Prove the properties of the streams, the buses and the arithmetic with Yosys and z3.

    Every input is free, the reset too. Each proof has copies of its component that were broken on purpose,
    on which its properties must fail. Answers are kept in build/cache/formal and found again while the
    hardware and the properties are unchanged. Without PROOF all are asked, and the result is kept for the
    page of what has been verified. Ends with an error if a property does not hold, or a broken copy passes.

    \b
    Example: fastac prove formal frame_guard_2x2
    """
    from fastac.sim.formal import campaign
    from fastac.store.evidence import keep

    chosen = [proof for proof in campaign.proofs(names) if proof.quick or not quick]
    outcomes = campaign.campaign(chosen, click.echo, jobs)
    if not names and not quick:
        click.echo(f"written: {keep(campaign.evidence(outcomes))}")
    wrong = [outcome.proof.name for outcome in outcomes if not outcome.holds]
    if wrong:
        raise click.ClickException(f"not proven: {', '.join(wrong)}")
    click.echo(f"{len(outcomes)} proofs hold")


@prove.command()
@click.option(
    "--builds",
    type=INPUT,
    default=Path("build"),
    show_default=True,
    help="Folder with the builds of the scenes paper, fast and force; those that are missing are left out.",
)
@click.option(
    "--photographs",
    type=INPUT,
    help="Folder whose press/*.png are sent as frames too. [default: simulated frames only]",
)
@click.option("--only", multiple=True, help="Of the designs, only this one; can be given several times.")
@click.option(
    "--evidence",
    type=OUTPUT_FOLDER,
    default=FOLDER,
    show_default=True,
    help="Folder for the campaign's result.",
)
@progress_option
def simulators(builds, photographs, only, evidence, progress):
    """Send frames through other makers' simulators, under benches that share nothing with the project's own.

    The Verilog of the scenes paper, fast and force goes through Icarus Verilog, in which an unknown stays
    visible, and through Yosys' CXXRTL; the netlists after synthesis of the force scene at 32x32 pixels
    (design force_32) through Icarus. Every beat and register is compared with the integers, unknown bits of
    outputs are counted, and the streams' handshakes checked. Frames of 128x128 pixels take Icarus minutes
    each. What has been simulated is kept. Ends with an error if anything differs.

    \b
    Example: fastac prove simulators --photographs ../photographs
             fastac prove simulators --only force_32
    """
    from fastac.studies.simulators import evidence as result
    from fastac.studies.simulators.campaign import RUNS, Campaign

    runs = [run for run in RUNS if not only or run.design in only]
    if not runs:
        known = ", ".join(dict.fromkeys(run.design for run in RUNS))
        raise click.ClickException(f"--only {' '.join(only)}: no such design; there is {known}")
    for line in result.measure(Campaign(builds, photographs, progress), runs=runs, folder=evidence):
        click.echo(line)


@prove.command()
@click.option(
    "--evidence",
    type=INPUT,
    default=FOLDER,
    show_default=True,
    help="Folder with the campaigns' results.",
)
@output_option("File to write.", OUTPUT_FILE, "docs/verification.md")
def page(evidence, output):
    """Write the page of what has been verified, from the results of the campaigns.

    \b
    Example: fastac prove page
    """
    from fastac.report import verification
    from fastac.store.files import write_text

    output = output or Path("docs/verification.md")
    write_text(output, verification.of_folder(evidence))
    click.echo(f"written: {output}")
