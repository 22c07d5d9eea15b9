"""Commands of the verification campaigns: proofs, mutants, other simulators, faults, and their page."""

from pathlib import Path

import click

from fastac.cli.common import (
    INPUT,
    OUTPUT_FILE,
    OUTPUT_FOLDER,
    Group,
    output_option,
    progress_option,
    store_option,
)
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
@click.option(
    "--only",
    multiple=True,
    help="Of the designs, only this one; can be given several times. The campaign's result is left as it is.",
)
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
    Example: fastac prove simulators --only force_32
    """
    from fastac.studies.simulators import evidence as result
    from fastac.studies.simulators.campaign import RUNS, Campaign

    runs = [run for run in RUNS if not only or run.design in only]
    if not runs:
        known = ", ".join(dict.fromkeys(run.design for run in RUNS))
        raise click.ClickException(f"--only {' '.join(only)}: no such design; there is {known}")
    folder = None if only else evidence
    for line in result.measure(Campaign(builds, photographs, progress), runs=runs, folder=folder):
        click.echo(line)


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
    help="Folder with the campaigns' new results.",
)
@click.option(
    "--kept",
    type=OUTPUT_FOLDER,
    default=Path("docs/evidence"),
    show_default=True,
    help="Folder with earlier results, for campaigns that have no new one; the new ones are copied to it.",
)
@output_option("File to write.", OUTPUT_FILE, "docs/verification.md")
def page(evidence, kept, output):
    """Write the page of what has been verified, from the results of the campaigns.

    \b
    Example: fastac prove page
    """
    from fastac.report import verification
    from fastac.store.files import write_text

    output = output or Path("docs/verification.md")
    write_text(output, verification.of_folders(evidence, kept))
    click.echo(f"written: {output}")
