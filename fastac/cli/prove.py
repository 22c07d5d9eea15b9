"""Commands of the verification campaigns: proofs, mutants, other simulators, faults, and their page."""

from pathlib import Path

import click

from fastac.cli.common import INPUT, OUTPUT_FILE, Group, output_option
from fastac.store.evidence import FOLDER


@click.group(cls=Group)
def prove():
    """Campaigns that verify the hardware; each keeps its result in build/evidence/."""


@prove.command()
@click.argument("components", nargs=-1)
@click.option("--mutants", type=click.IntRange(1), default=100, show_default=True, help="Of each component.")
@click.option("--seed", type=int, default=18, show_default=True, help="Draws other mutants.")
@click.option("--jobs", type=click.IntRange(1), default=2, show_default=True, help="Components side by side.")
def mutation(components, mutants, seed, jobs):
    """Mutate components of the hardware, by name such as stream/fork, or all; their own tests must fail.

    What is unchanged since an earlier run is not run again (build/mutate). The result of all components goes
    to build/evidence/mutation.json.

    \b
    Example: fastac prove mutation stream/fork poisson/depth
    """
    import time

    from tabulate import tabulate

    from fastac.sim.mutate import campaign
    from fastac.sim.mutate.components import COMPONENTS
    from fastac.store.evidence import keep

    unknown = set(components) - {component.name for component in COMPONENTS}
    if unknown:
        names = ", ".join(component.name for component in COMPONENTS)
        raise click.UsageError(f"{', '.join(sorted(unknown))}: expected one of {names}")
    chosen = [c for c in COMPONENTS if not components or c.name in components]
    begun = time.monotonic()
    try:
        scores = campaign.run(chosen, count=mutants, seed=seed, jobs=jobs)
    except campaign.CampaignError as error:
        raise click.ClickException(str(error)) from None
    found = campaign.evidence(scores, chosen, time.monotonic() - begun, seed)
    for table in found.tables:
        click.echo(tabulate(table.rows, list(table.columns), disable_numparse=True) + "\n")
    click.echo(found.summary)
    if not components:
        click.echo(f"written: {keep(found)}")


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
