"""Commands of the verification campaigns: proofs, mutants, other simulators, faults, and their page."""

from pathlib import Path

import click

from fastac.cli.common import INPUT, OUTPUT_FILE, Group, output_option
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
