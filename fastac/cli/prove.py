"""Commands of the verification campaigns: proofs, mutants, other simulators, faults, and their page."""

from pathlib import Path

import click

from fastac.cli.common import INPUT, OUTPUT_FILE, Group, output_option, progress_option, store_option
from fastac.store.evidence import FOLDER


@click.group(cls=Group)
def prove():
    """Campaigns that verify the hardware; each keeps its result in build/evidence/."""


@prove.command()
@click.option("--count", default=10_200, show_default=True, help="Faults, spread evenly over the designs.")
@click.option("--seed", default=1, show_default=True, help="Of the generator of faults.")
@click.option("--design", "designs", multiple=True, help="Only this design; may be repeated. [default: all]")
@click.option(
    "--faults", "numbers", help="Only these faults of one design, such as 600-677; nothing is kept."
)
@click.option("-n", "--jobs", default=2, show_default=True, help="Processes.")
@store_option("batches of faults that passed")
@progress_option
def faults(count, seed, designs, numbers, jobs, store, progress):
    """Play thousands of faults to small designs: after each the next good frame must be exact.

    Short, long and broken lines and frames, stalls, resets at random clocks, register traffic and
    calibrations that are cut off, drawn from a seed; every flag of ERRORS is compared. The first failure ends
    the campaign with a line that says how to repeat it; otherwise the result goes to
    build/evidence/faults.json.

    \b
    Example: fastac prove faults --design dst2d_1 --faults 600-677
    """
    import time

    from fastac.sim.faults import campaign
    from fastac.sim.faults.designs import DESIGNS
    from fastac.sim.faults.summary import evidence
    from fastac.store.evidence import keep

    start, workplace = time.monotonic(), Path("build/faults")
    known = tuple(DESIGNS)
    for name in designs:
        if name not in known:
            raise click.ClickException(f"design {name!r}: expected one of {', '.join(known)}")
    run = campaign.Campaign(designs or known, seed, store, workplace, jobs=jobs, progress=progress)
    if numbers:
        if len(designs) != 1:
            raise click.ClickException("--faults: expected one --design, whose faults they are")
        played = run.repeat(designs[0], numbers)
        click.echo(f"{designs[0]}, seed {seed}: {played} faults, nothing wrong")
        return
    coverage = run.run(count)
    # What an earlier run has played took its time as well.
    seconds = max(time.monotonic() - start, run.seconds.total() / jobs)
    found = evidence(run.records, run.seconds, seed=seed, command="make faults", seconds=seconds)
    click.echo(found.summary)
    missing = ", ".join(f"{kind} in {state}" for kind, state in coverage.missing())
    if designs:
        click.echo(f"not reached: {missing or 'nothing'}")
        return
    click.echo(f"written: {keep(found)}")
    if missing or coverage.unexpected():
        raise click.ClickException(f"not reached: {missing}; impossible but reached: {coverage.unexpected()}")


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
