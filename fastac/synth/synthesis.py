"""`fastac synth`: what the hardware needs and what clock it reaches, part by part, without Vivado."""

import hashlib
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path

from fastac.gateware.target import tools as synth_tools
from fastac.gateware.target.device import Device
from fastac.gateware.target.ecp5 import Ecp5
from fastac.gateware.target.tools import ToolError
from fastac.store.files import write_json
from fastac.store.progress import progress_bar
from fastac.store.recording import unrecorded
from fastac.store.steps import Step
from fastac.store.store import Store, open_store
from fastac.synth import place_ecp5, yosys
from fastac.synth.netlist import Part, parts
from fastac.synth.synthesis_tasks import AGAIN, COUNT, EVERY, LUTS, PLACE, PLACEMENTS, REGISTERS, TASKS, Task

FILE = "synth.json"


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

    Raises ToolError for a pattern that matches nothing.
    """
    patterns = tuple(patterns)
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for part in found for name in part.instances):
            names = ", ".join(part.name for part in found)
            raise ToolError(f"--module {pattern}: no such module; there are {names}")
    return [
        part
        for part in found
        if not patterns or any(fnmatchcase(n, p) for n in part.instances for p in patterns)
    ]


def perform(
    found: list[Part],
    store: Store,
    chosen: list[Part],
    tasks: Iterable[Task],
    *,
    device: Device,
    progress: bool,
    jobs: int = 1,
) -> dict[str, dict]:
    """Results by part and task: those in the store, and those that `tasks` find for the `chosen` parts.

    What a tool says when it fails is the result {"error": one line}, and is not kept; the other parts go on.
    `jobs` tools run side by side.
    """
    results: dict[str, dict] = {part.name: {} for part in found}
    waiting = []
    for part in found:
        for task in EVERY:
            step = task.step(part, device.dsp.name)
            if store.is_current(step):
                results[part.name][task.name] = store.value(step)
            elif task in tasks and part in chosen:
                waiting.append((part, task, step))
    if waiting:
        synth_tools.check_installed(sorted({tool for _, task, _ in waiting for tool in task.tools}))
    # The counts of all parts first: they take less time.
    waiting.sort(key=lambda job: EVERY.index(job[1]))
    with progress_bar(total=len(waiting), desc="synth", unit="run", enabled=progress, leave=True) as bar:

        def find(job: tuple[Part, Task, Step]) -> None:
            part, task, step = job
            bar.set_postfix_str(f"{part.name}: {task.name}")
            try:
                with unrecorded():
                    result = store.value(step)
            except ToolError as error:
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


def slowest(results: dict[str, dict], chosen: Iterable[Part], count: int) -> list[Part]:
    """The `count` parts of `chosen` whose placement reached the lowest clocks."""
    clocks = {part.name: results[part.name].get(PLACE.name, {}).get("clock_mhz") for part in chosen}
    placed = [part for part in chosen if clocks[part.name] is not None]
    return sorted(placed, key=lambda part: clocks[part.name])[:count]


def worst_placement(results: dict[str, dict]) -> dict | None:
    """A part's placement of the lowest clock, or None; with `clocks_mhz` of all where there are several."""
    found = [results[task.name] for task in PLACEMENTS if "clock_mhz" in results.get(task.name, {})]
    if not found:
        return None
    worst = min(found, key=lambda placed: placed["clock_mhz"])
    return worst if len(found) == 1 else worst | {"clocks_mhz": [placed["clock_mhz"] for placed in found]}


def describe(found: list[Part], results: dict[str, dict], device: Device) -> dict:
    """Module by module and in sum, every figure with its origin; what was not obtained is absent.

    device : what was counted for, and what the look-up tables' share is of
    """
    options = yosys.TARGETS[device.dsp.name].options
    origins = {
        COUNT.name: yosys.COUNT_ORIGIN.format(options=options),
        REGISTERS.name: yosys.REGISTER_ORIGIN,
        LUTS.name: yosys.LUT_ORIGIN.format(options=options),
        PLACE.name: place_ecp5.ORIGIN,
    }
    modules = {}
    for part in found:
        entry = {"instances": part.instances}
        by_task = results[part.name]
        if worst := worst_placement(by_task):
            by_task = {name: r for name, r in by_task.items() if "error" in r or "clock_mhz" not in r}
            by_task[PLACE.name] = worst
        for task, result in by_task.items():
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
        share = round(100 * totals["lut"]["value"] / device.lut, 2)
        totals["lut_share_percent"] = stated(
            share, f"lut of the {device.part}'s {device.lut:,}; {totals['lut']['origin']}"
        )
    return {"modules": modules, "totals": totals}


def synthesise(
    bundle,
    folder: Path,
    *,
    device: Device,
    store: Path,
    place_and_route: bool = True,
    modules: Iterable[str] = (),
    placements: int = 1,
    again: int = 0,
    jobs: int = 1,
    progress: bool = False,
) -> dict:
    """Synthesise a bundle's hardware part by part; writes `synth.json` into `folder`, returns its content.

    device : the device that the hardware is for
    store : folder of the step store
    modules : patterns of the parts that the tools run for; of the others only what is in the store is shown
    placements, again : how often each of the `again` slowest parts is placed in all, each time from another
        seed; the lowest clock counts
    jobs : tools that run side by side
    """
    found, rtlil_sha256 = elaborate(bundle)
    tasks = TASKS if place_and_route else tuple(task for task in TASKS if not task.placed)
    chosen = select(found, modules)
    run = partial(perform, found, open_store(store), device=device, progress=progress, jobs=jobs)
    results = run(chosen, tasks)
    if place_and_route and placements > 1:
        results = run(slowest(results, chosen, again), AGAIN[: placements - 1])
    content = {
        "bundle_sha256": bundle.digest,
        "rtlil_sha256": rtlil_sha256,
        "tools": synth_tools.VERSIONS,
        **describe(found, results, device),
    }
    write_json(folder / FILE, content)
    return content
