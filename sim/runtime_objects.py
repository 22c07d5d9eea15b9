"""Cache of Verilator's runtime objects and precompiled headers.

They are the same for all simulators with the same compiler flags, and compiling them takes most of the build
time of a small simulator.
"""

import hashlib
import os
import shlex
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

from filelock import FileLock

CACHE = Path("build/cache/verilator")
"""Objects by the hash of the compilers and the commands that make them."""
MAKEFILE = "Vtop.mk"
CLASSES = "Vtop_classes.mk"
"""Verilator's list of the sources that it has written."""
HEADER = "runtime.h"
HEADERS = ("verilated.h", "verilated_dpi.h", "verilated_vpi.h", "memory", "string")
"""Headers that all sources of a simulator include, so that HEADER includes them."""


@cache
def compiler_version(compiler: str) -> str:
    return subprocess.run([compiler, "--version"], capture_output=True, text=True, check=True).stdout


def verilator_version() -> str:
    """Verilator's version, as the text of the header that contains it."""
    return (Path(os.environ["VERILATOR_ROOT"]) / "include" / "verilated_config.h").read_text()


def compiled_with(folder: Path, optimisation: str) -> str:
    """The make variable that compiles the sources of a verilated `folder`, with the precompiled headers if
    they can be used.

    A design that Verilator divides into several sources has a precompiled header of its own. The compiler
    uses only one, which must be included first, so these sources do without the runtime's.
    """
    divided = "VM_PARALLEL_BUILDS = 1" in (folder / CLASSES).read_text()
    return f"OPT_FAST={optimisation}" if divided else f"OPT_FAST={optimisation} -include {HEADER}"


def _make(folder: Path, *arguments: str) -> str:
    call = ["make", "--no-print-directory", "-C", str(folder), "-f", MAKEFILE, *arguments]
    return subprocess.run(call, capture_output=True, text=True, check=True).stdout


def commands(folder: Path, optimisation: str) -> dict[str, list[str]]:
    """{file of the runtime: command that compiles it} for the verilated `folder`."""
    rule = "runtime: ; @echo $(VK_GLOBAL_OBJS); echo $(CXX) $(OPT_FAST) $(CXXFLAGS) $(CPPFLAGS)"
    objects, header = _make(folder, "--eval", rule, f"OPT_FAST={optimisation}", "runtime").splitlines()
    calls = [shlex.split(line) for line in _make(folder, "-n", "-B", *objects.split()).splitlines()]
    found = {call[call.index("-o") + 1]: call for call in calls if "-o" in call}
    compiled = f"{HEADER}.gch"
    return found | {compiled: [*shlex.split(header), "-x", "c++-header", "-o", compiled, HEADER]}


class RuntimeObjects:
    """The runtime objects for the simulator in a verilated `folder`, compiled with flag `optimisation`."""

    def __init__(self, folder: Path, optimisation: str):
        self.folder, self.commands = folder, commands(folder, optimisation)
        compilers = [compiler_version(name) for name in sorted({call[0] for call in self.commands.values()})]
        content = repr((sorted(self.commands.items()), compilers, verilator_version(), HEADERS))
        self.cached = CACHE / hashlib.sha256(content.encode()).hexdigest()[:24]

    def install(self) -> None:
        """Put the objects into the folder, so that make need not; compile them first if the cache lacks them.

        The cache gets all of them or none. Processes that need the same ones wait for the first.
        """
        self.cached.parent.mkdir(parents=True, exist_ok=True)
        (self.folder / HEADER).write_text("".join(f"#include <{name}>\n" for name in HEADERS))
        with FileLock(f"{self.cached}.lock"):
            if not self.cached.is_dir():
                self._fill_cache()
        for name in self.commands:
            target = self.folder / name
            target.unlink(missing_ok=True)
            if name.endswith(".gch"):  # 70 MB
                target.symlink_to((self.cached / name).resolve())
            else:
                shutil.copyfile(self.cached / name, target)

    def _fill_cache(self) -> None:
        with tempfile.TemporaryDirectory(dir=self.cached.parent, ignore_cleanup_errors=True) as temporary:
            part = Path(temporary) / "part"
            part.mkdir()
            for name, command in self.commands.items():
                subprocess.run(command, cwd=self.folder, capture_output=True, check=True)
                shutil.copyfile(self.folder / name, part / name)
            part.rename(self.cached)
