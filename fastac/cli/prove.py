"""Commands of the verification campaigns: proofs, mutants, other simulators, faults, and their page."""

from pathlib import Path

import click

from fastac.cli.common import INPUT, OUTPUT_FILE, Group, output_option
from fastac.store.evidence import FOLDER


@click.group(cls=Group)
def prove():
    """Campaigns that verify the hardware; each keeps its result in build/evidence/."""


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
