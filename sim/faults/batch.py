"""Faults through a simulator of their own, one after another."""

import json
import shutil
import time
from contextlib import suppress
from pathlib import Path

from fastac.sim.faults.designs import NAME
from fastac.sim.faults.generator import faults
from fastac.sim.faults.golden import Hardware, prepare
from fastac.sim.faults.script import Fault
from fastac.sim.runner import build


class FaultFound(RuntimeError):
    """The hardware did not do what it must after a fault: one line; `failure` has the details."""

    def __init__(self, message: str, failure: dict):
        super().__init__(message)
        self.failure = failure

    def __reduce__(self):  # it comes from another process
        return type(self), (str(self), self.failure)


def play(
    hardware: Hardware,
    verilog: Path,
    flip_flops: Path,
    chosen: list[Fault],
    seed: int,
    folder: Path,
    *,
    build_args: tuple[str, ...] = (),
) -> list[dict]:
    """Simulate the faults one after another; returns the bench's record of each.

    verilog, flip_flops : as `designs.elaborate` writes them; folder : for the simulator and all other files
    Raises FaultFound at the first fault after which something is wrong.
    """
    prepare(hardware, chosen, seed, folder)
    for stale in ("records.json", "failure.json"):
        (folder / stale).unlink(missing_ok=True)
    arguments = (str(flip_flops.resolve()), *build_args)
    runner = build(verilog, NAME, folder / "build", build_args=arguments)
    log = folder / "test.log"
    with suppress(SystemExit, RuntimeError):  # the runner's words for a test that failed; the files say more
        runner.test(
            hdl_toplevel=NAME,
            test_module="fastac.sim.benches.faults.bench",
            build_dir=folder / "build",
            extra_env={"BENCH": str(folder.resolve())},
            log_file=log,
        )
    if (folder / "failure.json").exists():
        failure = json.loads((folder / "failure.json").read_text())
        what = f"fault {failure['number']} ({', '.join(failure['kinds'])})"
        raise FaultFound(f"{what}: {failure['error'].splitlines()[0]}", failure)
    if not (folder / "records.json").exists():
        raise FaultFound(f"the bench ended without a result; see {log}", {})
    return json.loads((folder / "records.json").read_text())


def batch(
    folder: Path,
    design: str,
    own: Path,
    other: Path,
    verilog: Path,
    flip_flops: Path,
    numbers: list[int],
    seed: int,
    *,
    workplace: Path,
    progress: bool,
) -> dict:
    """A step: the records of the faults with these numbers, and the seconds that they took.

    own, other, verilog, flip_flops : as `designs.elaborate` writes them; workplace : folder for simulators
    A failure says how to repeat it; what it leaves in the workplace stays.
    """
    start, place = time.monotonic(), workplace / f"{design}_{numbers[0]}"
    hardware = Hardware.load(own, other)
    chosen = faults(hardware.shape, design, seed, numbers)
    try:
        records = play(hardware, verilog, flip_flops, chosen, seed, place)
    except FaultFound as error:
        again = [n for n in numbers if n <= error.failure.get("number", n)] or numbers
        command = f"fastac prove faults --design {design} --seed {seed} --faults {spans(again)}"
        raise FaultFound(f"{design}, seed {seed}, {error}; repeat with: {command}", error.failure) from None
    shutil.rmtree(place)
    return {"records": records, "seconds": time.monotonic() - start}


def spans(numbers: list[int]) -> str:
    """Numbers as text, such as "3-7,12"."""
    parts: list[list[int]] = []
    for number in numbers:
        if parts and parts[-1][-1] == number - 1:
            parts[-1].append(number)
        else:
            parts.append([number])
    return ",".join(str(part[0]) if len(part) == 1 else f"{part[0]}-{part[-1]}" for part in parts)


def numbers_of(text: str) -> list[int]:
    """The numbers that `spans` gives as `text`. Raises ValueError."""
    found = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        if not first.isdecimal() or (last and not last.isdecimal()):
            raise ValueError(f"{text!r}: expected numbers of faults, such as 600-677 or 3,8")
        found += range(int(first), int(last or first) + 1)
    return found
