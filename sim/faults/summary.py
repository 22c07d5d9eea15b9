"""What a fault campaign has shown, as evidence: by design, by kind, and which bins were reached."""

from collections import Counter
from collections.abc import Mapping, Sequence

from fastac.sim.faults.coverage import PLACES, Coverage, impossible
from fastac.sim.faults.designs import DESIGNS
from fastac.sim.faults.kinds import KINDS, STATES
from fastac.store.evidence import Evidence, Table

NOT_COVERED = (
    "Power-up randomises all flip-flops but those that a reset keeps on purpose: the loaded calibration, and"
    " two bits that let the background be written. Memories keep their contents.",
    "Taking a new background while faults happen: tests/gateware/test_top_zynq.py has one reset inside it.",
    "Which saturations and late results a soft reset cuts off depends on single clocks: there these flags may"
    " stand or not. All other flags are exact.",
    "The timeout's exact clock, which the frame guard's own test counts: here a pause is clearly shorter, or"
    " lasts until the flag stands.",
    "A force that the host does not read before the next one comes: of the frames of a fault only the last"
    " one's is always read. Images that leave on streams are compared of all frames, beat by beat.",
    "Another FRAME_TIMEOUT during a frame, and a host that clears single flags while others come.",
    "Images larger than 20 × 20 pixels, and bits that flip inside the hardware.",
    "FrameGuard's state is read from its register in the simulator; no port shows it.",
)
STATES_NOTE = (
    "The state of the frame guard in the clock in which the fault begins: the first beat of the faulty line"
    " or frame is accepted, a reset or a register write takes effect, a pause or a stall begins. WAIT:"
    " between frames; LINE: inside a frame; DROP: surplus beats of a line are dropped; PAD: a short line is"
    " padded; FILL: a frame is padded. A fault counts with each of its kinds."
)
KINDS_NOTE = (
    "Three in ten faults have a second one in the same frame, except those of calibrations. Frames before a"
    " fault are faulty too where that is the way into a state. All of ERRORS is compared each time; the four"
    " flags that stood most often are named."
)


def evidence(
    records: Sequence[tuple[str, dict]],
    processor_s: Mapping[str, float],
    *,
    seed: int,
    command: str,
    seconds: float,
) -> Evidence:
    """The evidence of the bench's records of faults, each with the design's name.

    processor_s : seconds of all batches of a design; seconds : of the campaign
    """
    coverage = Coverage(records)
    total = Counter()
    for _, record in records:
        total.update({key: record[key] for key in ("frames", "bad", "clocks")})
    missing = [f"{kind} in {state}" for kind, state in coverage.missing()]
    possible = sum(len(kind.states()) for kind in KINDS.values())
    summary = (
        f"{len(records):,} faults through {len(processor_s)} designs, seed {seed}: after each one the next"
        f" good frame was exact on every output, and the right flags stood, no others."
        f" {total['frames']:,} frames were compared, {total['bad']:,} repaired ones among them."
        f" {possible - len(missing)} of {possible} possible pairs of a kind of fault and a state of the frame"
        f" guard were reached. The AXI rules were checked in each of {total['clocks']:,} clocks. The batches"
        f" took {sum(processor_s.values()) / 60:.0f} minutes in all."
    )
    return Evidence(
        name="faults",
        title="Faults and misuse",
        command=command,
        summary=summary,
        seconds=seconds,
        tables=[
            _by_design(records, processor_s),
            _by_kind(records, coverage),
            _cross(coverage),
            _places(coverage),
        ],
        not_covered=[
            *(f"Not reached: {text}." for text in missing),
            *(f"Cannot be: {', '.join(names)}: {reason}." for reason, names in impossible().items()),
            *NOT_COVERED,
        ],
    )


def _by_design(records: Sequence[tuple[str, dict]], processor_s: Mapping[str, float]) -> Table:
    rows = []
    for design, spent in processor_s.items():
        mine = [record for name, record in records if name == design]
        keys = ("frames", "bad", "beats", "results", "clocks")
        counts = [len(mine), *(sum(record[key] for record in mine) for key in keys)]
        wanted = DESIGNS[design]
        solver = "none" if wanted["outputs"] == ("normals",) else wanted.get("solver", "dst2d")
        facts = [
            solver,
            wanted.get("lanes", 1),
            ", ".join(wanted["outputs"]),
            wanted.get("weights", "loadable"),
        ]
        rows.append([design, *facts, *(f"{count:,}" for count in counts), f"{spent:.0f}"])
    columns = ["design", "solver", "pixels a clock", "outputs", "weights", "faults", "frames compared"]
    columns += ["of these repaired", "output beats compared", "results read by the host", "clocks", "seconds"]
    return Table("By design", columns, rows)


def _by_kind(records: Sequence[tuple[str, dict]], coverage: Coverage) -> Table:
    first, second, flags = Counter(), Counter(), {name: Counter() for name in KINDS}
    for _, record in records:
        kind, *others = record["kinds"]
        first[kind] += 1
        second.update(others)
        if not others:
            flags[kind].update(record["errors"])
    rows = []
    for name, kind in KINDS.items():
        designs = len({design for k, design in coverage.designs if k == name})
        seen = ", ".join(f"{flag} {count}" for flag, count in flags[name].most_common(4))
        rows.append([name, kind.meaning, first[name], second[name], designs, seen])
    columns = [
        "kind",
        "what happens",
        "faults",
        "as the second fault",
        "designs",
        "flags, where it was alone",
    ]
    return Table("By kind of fault", columns, rows, KINDS_NOTE)


def _cross(coverage: Coverage) -> Table:
    rows = [
        [name, *(coverage.states[name, s] or ("impossible", 0)[s in kind.states()] for s in STATES)]
        for name, kind in KINDS.items()
    ]
    return Table("Kinds of faults × states of the frame guard", ["kind", *STATES], rows, STATES_NOTE)


def _places(coverage: Coverage) -> Table:
    shares = sorted({share for _, share in coverage.stalls})
    rows = []
    for name in KINDS:
        places = [coverage.places[name, place] for place in PLACES]
        rows.append([name, *places, *(coverage.stalls[name, share] for share in shares)])
    columns = ["kind", *PLACES, *(f"outputs stall in {share:.0%} of the clocks" for share in shares)]
    note = (
        f"{sum(coverage.pairs.values()):,} faults had a second one, in {len(coverage.pairs)} different pairs."
    )
    return Table("Where in the camera's frame, and with which stalls", columns, rows, note)
