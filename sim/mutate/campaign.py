"""The mutation campaign: how many mutants of each component its own tests find."""

import ast
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

from fastac.gateware.target.tools import VERSIONS, ToolError
from fastac.sim.mutate.components import COMPONENTS, Component
from fastac.sim.mutate.equivalence import equivalent
from fastac.sim.mutate.netlist import Mutant, MutatedDesign
from fastac.store.evidence import Evidence, Table
from fastac.store.files import content_hash, digest_file, read_json, write_json
from fastac.store.progress import progress_bar
from fastac.store.references import parsed

FOLDER = Path("build/mutate")
SEED = 18
MUTANTS = 100
"""Of each component, at least; fewer where there are no more."""
NEEDED = 0.95
ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 3600
CHOSEN = "not full or mutate"
"""Marks of the tests that run (docs/testing.md)."""
OWN = ("fastac.sim.mutate.plugin", "fastac.sim.benches.mutants", "fastac.sim.mutate.equivalence")
NAME = re.compile(r"\bfastac(?:\.\w+)+")


class CampaignError(RuntimeError):
    """A component whose tests do not run with mutants; the message says where their output is."""


@dataclass(frozen=True)
class Survivor:
    """A mutant that no test has found: its place in the source, what it changes, and the simulator."""

    source: str
    what: str
    simulator: str


@dataclass(frozen=True)
class Score:
    """Mutants of one component: how many there are, are equivalent, are caught and are left."""

    component: str
    mutants: int
    equivalent: int
    caught: int
    survivors: tuple[Survivor, ...]
    seconds: float

    @property
    def share(self) -> float:
        """Caught, of those that are not proven equivalent."""
        return self.caught / max(self.mutants - self.equivalent, 1)


def sources_of(paths: Iterable[Path]) -> list[Path]:
    """The project's modules that `paths` import, they included, and those that they import."""
    found, waiting = set(), [path.resolve() for path in paths]
    while waiting:
        path = waiting.pop()
        if path in found:
            continue
        found.add(path)
        text = path.read_text()
        names = set(NAME.findall(text))
        for node in ast.walk(parsed(text)):
            if isinstance(node, ast.ImportFrom) and node.module:
                names |= {f"{node.module}.{alias.name}" for alias in node.names}
        files = (ROOT / f"{name.replace('.', '/')}.py" for name in names if name.startswith("fastac."))
        waiting += [file.resolve() for file in files if file.is_file()]
    return sorted(found)


def key(component: Component, count: int, seed: int) -> str:
    """Digest of all that the component's score depends on."""
    tests = {ROOT / test.split("::")[0] for test in component.test_paths}
    fixtures = [ROOT / "tests" / "conftest.py", ROOT / "tests" / "gateware" / "conftest.py"]
    own = [ROOT / f"{name.replace('.', '/')}.py" for name in OWN]
    files = sources_of([*tests, *fixtures, *own, ROOT / "fastac" / component.source])
    digests = [[path.name, digest_file(path)] for path in files]
    return content_hash(component.name, component.tests, component.designs, count, seed, digests, VERSIONS)[
        :16
    ]


def run_component(
    component: Component, *, count: int = MUTANTS, seed: int = SEED, folder: Path = FOLDER
) -> Score:
    """The component's score, kept in `folder` by the content of all sources that it depends on."""
    place = (folder / component.name.replace("/", ".")).resolve()
    kept = place / f"score-{key(component, count, seed)}.json"
    if kept.exists():
        content = read_json(kept)
        return Score(**{**content, "survivors": tuple(Survivor(**s) for s in content["survivors"])})
    begun = time.monotonic()
    share = -(-count // component.designs)
    settings = {"designs": component.designs, "count": share, "seed": seed}
    tried = run_tests(component.test_paths, component.source, place, **settings)
    survivors, same, caught, mutants = [], 0, 0, 0
    for entry in tried:
        found = [Mutant(m["number"], m["options"], m["source"]) for m in entry["mutants"]]
        design = MutatedDesign(entry["name"], Path(entry["folder"]), found)
        left = [mutant for mutant in found if str(mutant.number) not in entry["caught"]]
        proven = equivalent(design, [mutant.number for mutant in left])
        survivors += [
            Survivor(mutant.source.removeprefix("fastac/"), mutant.what, entry["simulator"])
            for mutant in left
            if mutant.number not in proven
        ]
        same, caught, mutants = same + len(proven), caught + len(entry["caught"]), mutants + len(found)
    if not mutants:
        raise CampaignError(
            f"{component.name}: its tests bring up no design with a cell of {component.source}"
        )
    score = Score(component.name, mutants, same, caught, tuple(survivors), time.monotonic() - begun)
    write_json(kept, asdict(score))
    return score


def run_tests(
    paths: Sequence[str], source: str, folder: Path, *, designs: int, count: int, seed: int
) -> list[dict]:
    """Run tests with mutants of what comes from the file `source`; what plugin.py found, design by design."""
    folder = folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    job, log, verdicts = folder / "job.json", folder / "pytest.log", folder / "verdicts.json"
    verdicts.unlink(missing_ok=True)
    content = {"files": [source], "designs": designs, "count": count, "seed": seed, "folder": str(folder)}
    write_json(job, content)
    command = [sys.executable, "-m", "pytest", "-q", "-c", str(ROOT / "pyproject.toml")]
    command += ["-p", "no:cacheprovider", "-p", "fastac.sim.mutate.plugin", "-m", CHOSEN]
    # Forked children leave designs unused that their parent has made; a run takes longer than a test may.
    command += ["-W", "ignore::amaranth.hdl.UnusedElaboratable", "-o", f"timeout={LIMIT_S}"]
    with log.open("w") as output:
        ran = subprocess.run(
            [*command, *paths],
            cwd=ROOT,
            env=os.environ | {"FASTAC_MUTATE": str(job)},
            stdout=output,
            stderr=subprocess.STDOUT,
            check=False,
        )
    if ran.returncode or not verdicts.exists():
        raise CampaignError(f"{source}: its tests fail without a mutant too: see {log}")
    return read_json(verdicts)


def run(
    components: Sequence[Component] = COMPONENTS,
    *,
    count: int = MUTANTS,
    seed: int = SEED,
    jobs: int = 1,
    folder: Path = FOLDER,
    progress: bool = True,
) -> list[Score]:
    """The scores of the components, `jobs` at a time; raises CampaignError once the others are done."""
    if not (ROOT / "tests").is_dir():
        raise CampaignError(f"{ROOT}: no folder tests/: the campaign needs the repository")
    with (
        ThreadPoolExecutor(jobs) as pool,
        progress_bar(desc="mutants", total=len(components), enabled=progress) as bar,
    ):

        def one(component: Component) -> Score | Exception:
            try:
                return run_component(component, count=count, seed=seed, folder=folder)
            except (CampaignError, ToolError) as error:
                return error
            finally:
                bar.update()

        found = list(pool.map(one, components))
    errors = [str(result) for result in found if isinstance(result, Exception)]
    if errors:
        raise CampaignError("; ".join(errors))
    return found


def why(survivor: Survivor, component: Component) -> str | None:
    """Why the component's entry allows the mutant; None if it does not."""
    path, _, line = survivor.source.rpartition(":")
    code = (ROOT / "fastac" / path).read_text().splitlines()[int(line) - 1]
    for allowed in component.allowed:
        if allowed.code in code and survivor.what.startswith(allowed.changes or ""):
            return allowed.why
    return None


def evidence(scores: Sequence[Score], components: Sequence[Component], seconds: float, seed: int) -> Evidence:
    """The campaign's result for the page."""
    by_name = {component.name: component for component in components}
    rows = [
        [f"gateware/{s.component}.py", s.mutants, s.equivalent, s.caught, len(s.survivors), f"{s.share:.1%}"]
        for s in scores
    ]
    left = [
        [
            survivor.source,
            survivor.what,
            why(survivor, by_name[score.component]) or "not explained",
        ]
        for score in scores
        for survivor in score.survivors
    ]
    mutants, same = sum(s.mutants for s in scores), sum(s.equivalent for s in scores)
    caught = sum(s.caught for s in scores)
    datapath = [s for s in scores if by_name[s.component].datapath]
    enough = sum(s.share >= NEEDED for s in datapath)
    return Evidence(
        "mutation",
        "Mutants of the hardware",
        "make mutate",
        f"{caught} of {mutants - same} mutants ({caught / max(mutants - same, 1):.1%}) are found by tests of"
        f" the mutated component itself; {same} more are proven equivalent. {enough} of {len(datapath)}"
        f" components of the datapath reach {NEEDED:.0%}. Seed {seed}.",
        seconds,
        [
            Table(
                "Mutants by component",
                ["component", "mutants", "equivalent", "caught", "survived", "score"],
                rows,
                "Yosys' `mutate` changes one bit of one cell that comes from the component's source. Caught:"
                " one of the component's tests in `make test` fails. Equivalent: proven by SAT to behave like"
                " the original. Survived: everything else, undecided ones included. The score is"
                " caught / (mutants − equivalent).",
            ),
            Table("Mutants that survive", ["source", "change", "why it is allowed"], left),
        ],
        [
            "Clocks, outputs of registers (their inputs are mutated) and initial contents of memories are not"
            " mutated.",
            "The connections of the whole (datapath.py, top_zynq.py) are not mutated: tests take minutes.",
            "dst2d, pixel_network and dot_stream only connect components, and are not mutated; the components"
            " are.",
            "calibration.py, raster_outputs.py and the cycle formulas hold no logic of the hardware.",
            "A test that takes more than four times the processor time of the unchanged design, and at least"
            " 2 s, counts as one that fails: the benches' own limits, in clocks, would come later.",
        ],
    )
