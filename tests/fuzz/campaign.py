"""The campaign of bad files, `make fuzz`: every reader of tests/fuzz with thousands of damaged files.

    python tests/fuzz/campaign.py [--seed N] [--jobs N] [--only TEXT] [--share X]

Each reader is given its cases in batches, a process each, which is killed where a case takes more than 5 s of
processor time, and in which more than 2 GB of memory cannot be had. Finished batches are kept in build/fuzz
by seed and code, so that an interrupted campaign goes on. Cases that ended badly are kept there too.
"""

import argparse
import faulthandler
import importlib.util
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(HERE.parent / "shared"))

from fuzzing import LIMIT_S, Reader, Tally, run_batch  # noqa: E402
from hypothesis.errors import HypothesisWarning  # noqa: E402

from fastac.report.tables import text_table  # noqa: E402
from fastac.store.digest import path_digest  # noqa: E402
from fastac.store.evidence import Evidence, Table, keep  # noqa: E402
from fastac.store.files import content_hash, read_json, write_json  # noqa: E402
from fastac.store.progress import progress_bar  # noqa: E402

FOLDER = Path("build/fuzz")
BATCH = 5000
MEMORY_BYTES = 2 << 30
"""That a batch may ask for beyond what it has when it begins."""
SOURCES = ("fastac", "scenes", "sensor", "models", "gateware", "tests/fuzz", "tests/shared")
TITLE = "Bad files"


@dataclass(frozen=True)
class Batch:
    """Some of a reader's cases, drawn from a seed of their own."""

    reader: Reader
    seed: int
    count: int

    @property
    def file(self) -> Path:
        name = re.sub(r"\W+", "_", self.reader.name)
        return FOLDER / f"{name}-{self.seed}-{self.count}.json"


def readers() -> Iterator[Reader]:
    """The readers of all files beside this one."""
    for file in sorted(HERE.glob("test_*.py")):
        spec = importlib.util.spec_from_file_location(file.stem, file)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        yield from getattr(module, "READERS", ())


def code_digest() -> str:
    """Digest of all code that a result depends on."""
    files = sorted(file for place in SOURCES for file in (ROOT / place).resolve().rglob("*.py"))
    return content_hash([[file.relative_to(ROOT).as_posix(), path_digest(file)] for file in files])


def run_here(batch: Batch, code: str) -> None:
    """One batch in this process, its result in its file."""
    faulthandler.enable()
    warnings.simplefilter("error")
    warnings.simplefilter("ignore", HypothesisWarning)  # of large cases, which it would print
    # A folder in memory: results of sweeps are synchronised to the disk at each change.
    place = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    with tempfile.TemporaryDirectory(dir=place) as folder:
        run_batch(batch.reader, Path(folder), batch.seed, 2)  # imports and compiles what is needed
        taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        _, most = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (taken + MEMORY_BYTES, most))
        bad = FOLDER / f"{batch.file.stem}.bad"
        found = run_batch(batch.reader, Path(folder), batch.seed, batch.count, kill=True, keep=bad)
    write_json(batch.file, {"code": code, **vars(found)})


def run_apart(batch: Batch, code: str) -> Tally:
    """One batch in a process of its own; what a process that was killed leaves is a failure."""
    if batch.file.exists() and read_json(batch.file).get("code") == code:
        return _tally(batch)
    batch.file.unlink(missing_ok=True)
    arguments = ["--batch", batch.reader.name, str(batch.seed), str(batch.count), code]
    done = subprocess.run(
        [sys.executable, __file__, *arguments],
        capture_output=True,
        text=True,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
    )
    if done.returncode or not batch.file.exists():
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        reason = f"over {LIMIT_S:g} s, or crashed" if done.returncode < 0 else last
        return Tally(
            failures=[f"{batch.reader.name}: seed {batch.seed}: ended with {done.returncode}: {reason}"]
        )
    return _tally(batch)


def _tally(batch: Batch) -> Tally:
    found = read_json(batch.file)
    found.pop("code")
    return Tally(**found | {"refused": Counter(found["refused"])})


def run(chosen: list[Reader], seed: int, share: float, jobs: int) -> dict[str, Tally]:
    """All batches of the readers, some at a time; what became of them, by reader."""
    batches = []
    for reader in chosen:
        count = max(1, round(reader.count * share))
        batches += [Batch(reader, seed + k, min(BATCH, count - k * BATCH)) for k in range(-(-count // BATCH))]
    found = {reader.name: Tally() for reader in chosen}
    code = code_digest()
    with ThreadPoolExecutor(jobs) as pool:
        results = pool.map(lambda batch: (batch, run_apart(batch, code)), batches)
        for batch, tally in progress_bar(results, desc="fuzz", total=len(batches), unit="batch"):
            found[batch.reader.name].add(tally)
    return found


def table(found: dict[str, Tally]) -> Table:
    rows = []
    for name, tally in found.items():
        rows.append(
            [
                name,
                f"{tally.inputs:,}",
                f"{tally.results:,}",
                f"{tally.refused.total():,}",
                ", ".join(f"{count:,} {kind}" for kind, count in tally.refused.most_common()),
                f"{tally.commands:,}",
                len(tally.failures),
                f"{tally.longest_s:.2f} s",
            ]
        )
    return Table(
        "Damaged files, by reader",
        [
            "reader",
            "files",
            "gave a result",
            "refused in one line",
            "by error",
            "command line too",
            "else",
            "longest",
        ],
        rows,
        "Each file is a whole one with one to four changes: keys and arrays dropped, exchanged or of another"
        ' type, sizes that are not so, links elsewhere, bytes flipped, cut and inserted. "else" would be'
        " tracebacks, crashes, more than 5 s of processor time, more than 2 GB of memory, files left half"
        " written, and files opened outside the case's folder.",
    )


NOT_COVERED = (
    "Files that a program with knowledge of the format has made to do harm: cases are drawn at random, from"
    " changes that were thought of.",
    "A bundle whose hash was computed anew after the change is checked for the classes and fields of its"
    " stages, not for shapes and values that fit together.",
    "Large files: the samples have a few kilobytes, so that what takes long because a file is long is not"
    " seen.",
    "What libraries open in C code is not watched, only what Python opens. Links of HDF5 files to others are"
    " refused before they are followed, and playlists before a video is looked for.",
    "Memory that HDF5 clears for a text of a declared length is bounded by the file's size only where the"
    " text is stored contiguously or in plain chunks.",
)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=18)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes at a time")
    parser.add_argument("--only", default="", help="readers whose name contains this")
    parser.add_argument("--share", type=float, default=1.0, help="share of the cases, for a first look")
    parser.add_argument("--batch", nargs=4, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.batch:
        name, seed, count, code = given.batch
        reader = next(reader for reader in readers() if reader.name == name)
        run_here(Batch(reader, int(seed), int(count)), code)
        return 0
    began = time.monotonic()
    chosen = [reader for reader in readers() if given.only in reader.name]
    found = run(chosen, given.seed, given.share, given.jobs)
    shown = table(found)
    print(text_table(list(shown.columns), [[str(cell) for cell in row] for row in shown.rows]))
    failures = [failure for tally in found.values() for failure in tally.failures]
    seconds = time.monotonic() - began
    total = sum(tally.inputs for tally in found.values())
    summary = (
        f"{total:,} damaged files given to {len(found)} readers (seed {given.seed}): {len(failures)} ended in"
        " something else than a result or one line."
    )
    print(f"{summary} {seconds / 60:.1f} minutes")
    for kind, count in Counter(re.sub(r"/\S+|\d+", "…", failure)[:300] for failure in failures).most_common(
        40
    ):
        print(f"  {count} × {kind}")
    if not given.only and given.share == 1:
        print(keep(Evidence("fuzz", TITLE, "make fuzz", summary, seconds, [shown], NOT_COVERED)))
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
