"""All proofs, side by side, with their broken copies; what has been answered once is kept."""

import os
import tempfile
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path

from fastac.gateware.target.tools import VERSIONS
from fastac.sim.formal.exhaustive import Exhaustive
from fastac.sim.formal.proof import Proof
from fastac.sim.formal.proofs import (
    accumulators,
    axi_lite,
    calibration_loader,
    divider,
    dots,
    engines,
    feature_smoothing,
    frame_guard,
    frame_validity,
    packets,
    patches,
    pipelines,
    products,
    raster_port,
    read_ahead,
    registers,
    registers_packets,
    reordering,
    result_fifo,
    slip,
    streams,
)
from fastac.sim.formal.solve import TOOLS, Answer
from fastac.store.evidence import Evidence, Table
from fastac.store.files import content_hash, read_json, write_json

MODULES = (
    *(streams, frame_guard, raster_port, packets, frame_validity),
    *(axi_lite, registers, registers_packets, result_fifo, calibration_loader),
    *(pipelines, feature_smoothing, engines, reordering, patches, read_ahead, dots, slip),
    *(products, divider, accumulators),
)
CACHE = Path("build/cache/formal")
"""Answers by the digest of their question."""


def proofs(names: Iterable[str] = ()) -> list[Proof | Exhaustive]:
    """All proofs, or those of `names`; raises ValueError for a name that is none."""
    known = {proof.name: proof for module in MODULES for proof in module.PROOFS}
    for name in names:
        if name not in known:
            raise ValueError(f"proof {name!r}: there is none; the proofs are {', '.join(known)}")
    return [known[name] for name in names or known]


@dataclass(frozen=True)
class Outcome:
    """The answers to a proof and to its broken copies."""

    proof: Proof | Exhaustive
    answer: Answer
    broken: tuple[Answer, ...]

    @property
    def holds(self) -> bool:
        """The properties hold, and fail on every broken copy."""
        return self.answer.status == "pass" and all(answer.status == "fail" for answer in self.broken)

    @property
    def seconds(self) -> float:
        return self.answer.seconds + sum(answer.seconds for answer in self.broken)


def ask(proof: Proof | Exhaustive, index: int | None, cache: Path = CACHE) -> Answer:
    """The answer to a proof or to one of its broken copies, kept in `cache`; "unknown" is asked again."""
    tools = {name: VERSIONS[name] for name in TOOLS}
    path = cache / f"{content_hash(proof.key(index), tools)[:32]}.json"
    if path.exists():
        kept = read_json(path)
        return Answer(kept["status"], tuple(kept["failed"]), kept["seconds"])
    with tempfile.TemporaryDirectory(prefix="fastac_proof_") as folder:
        answer = proof.run(Path(folder), index)
    if answer.status != "unknown":
        write_json(path, asdict(answer))
    return answer


def run(
    chosen: Iterable[Proof | Exhaustive], jobs: int = 0, cache: Path = CACHE
) -> Iterator[tuple[int, Outcome]]:
    """Ask for all `chosen` proofs and their broken copies; yields (place among them, outcome) as they end.

    jobs : solvers side by side; 0: one for each core
    """
    chosen = list(chosen)
    questions = [(k, index) for k, proof in enumerate(chosen) for index in (None, *range(len(proof.breaks)))]
    answers: dict[tuple[int, int | None], Answer] = {}
    with ThreadPoolExecutor(jobs or os.cpu_count()) as pool:
        futures = {pool.submit(ask, chosen[k], index, cache): (k, index) for k, index in questions}
        try:
            for future in as_completed(futures):
                k, index = futures[future]
                answers[k, index] = future.result()
                broken = [answers.get((k, each)) for each in range(len(chosen[k].breaks))]
                if (k, None) in answers and None not in broken:
                    yield k, Outcome(chosen[k], answers[k, None], tuple(broken))
        finally:
            for future in futures:
                future.cancel()


def line(outcome: Outcome) -> str:
    """An outcome in a line: what holds, or which property fails."""
    proof, answer = outcome.proof, outcome.answer
    caught = sum(each.status == "fail" for each in outcome.broken)
    extent = proof.extent.split(":")[0]
    text = {"pass": f"holds for {extent}", "unknown": "UNDECIDED", "fail": "FAILS"}[answer.status]
    failed = f": {'; '.join(answer.failed)}" if answer.failed else ""
    copies = f"{caught} of {len(proof.breaks)} broken copies fail"
    return f"{proof.name:24s} {text}{failed}, {copies}, {outcome.seconds:.1f} s"


def evidence(outcomes: list[Outcome]) -> Evidence:
    """The campaign's result for the page of what has been verified."""
    unbounded = sum(not outcome.proof.bound for outcome in outcomes)
    rows, named = [], []
    for outcome in outcomes:
        proof, names = outcome.proof, outcome.proof.properties()
        fails = sum(each.status == "fail" for each in outcome.broken)
        copies = f"{fails} of {len(proof.breaks)}" if proof.breaks else None
        rows.append((proof.name, proof.size, len(names), proof.extent, copies, f"{outcome.seconds:.0f}"))
        named += [(proof.name, name) for name in names]
    held, copies = sum(outcome.holds for outcome in outcomes), sum(len(o.broken) for o in outcomes)
    return Evidence(
        "formal",
        "Formal proofs",
        "make formal",
        f"{held} of {len(outcomes)} proofs hold, {unbounded} of them without a bound, with {len(named)}"
        f" properties. Each of {copies} copies broken on purpose breaks one. Inputs and resets are free:"
        " every sequence of them is covered, within the rules that a proof names. SymbiYosys asks z3, with"
        " Amaranth's netlist. The time is the sum of the solver's times.",
        sum(outcome.seconds for outcome in outcomes),
        [
            Table(
                "Proofs",
                ("proof", "size, and why it stands for others", "properties", "holds for", "broken", "s"),
                rows,
                "`broken`: how many copies of the component with a fault put in break a property.",
            ),
            Table("Properties", ("proof", "property"), named),
        ],
        [
            "The proofs are of Amaranth's netlist; that its Verilog does the same is shown by simulation.",
            "Values that the arithmetic computes are compared by simulation, where no proof here names them.",
        ],
    )


def campaign(
    chosen: list[Proof | Exhaustive], echo: Callable[[str], None], jobs: int = 0, cache: Path = CACHE
) -> list[Outcome]:
    """Run `chosen`, with a line for each proof as it ends; returns the outcomes in order."""
    found: dict[int, Outcome] = {}
    for place, outcome in run(chosen, jobs, cache):
        found[place] = outcome
        echo(f"[{len(found)}/{len(chosen)}] {line(outcome)}")
    return [found[k] for k in sorted(found)]
