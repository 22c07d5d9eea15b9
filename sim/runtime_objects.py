"""Verilator's own runtime, compiled once instead of for every simulator.

Its objects, and its headers precompiled for the code of a design, are the same for all simulators with the
same flags, and take most of the time that a small one needs.
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
"""Objects by the hash of the compiler and the commands that make them."""
MAKEFILE = "Vtop.mk"
CLASSES = "Vtop_classes.mk"
"""What of a verilated folder says how its sources are divided."""
HEADER = "runtime.h"
HEADERS = ("verilated.h", "verilated_dpi.h", "verilated_vpi.h", "memory", "string")
"""What HEADER includes: whatever all of a simulator's sources include."""


@cache
def compiler_version(compiler: str) -> str:
    return subprocess.run([compiler, "--version"], capture_output=True, text=True, check=True).stdout


def verilator_version() -> str:
    """Of the include folder's own header: a package that changes has another version there."""
    return (Path(os.environ["VERILATOR_ROOT"]) / "include" / "verilated_config.h").read_text()


def compiled_with(folder: Path, optimisation: str) -> str:
    """The make variable for the sources of a verilated `folder`, in most cases behind the runtime's headers.

    A design that Verilator divides into several sources has a precompiled header of its own. The compiler
    takes one only, the first that is included, so there the runtime's stay away.
    """
    divided = "VM_PARALLEL_BUILDS = 1" in (folder / CLASSES).read_text()
    return f"OPT_FAST={optimisation}" if divided else f"OPT_FAST={optimisation} -include {HEADER}"


def _make(folder: Path, *arguments: str) -> str:
    call = ["make", "--no-print-directory", "-C", str(folder), "-f", MAKEFILE, *arguments]
    return subprocess.run(call, capture_output=True, text=True, check=True).stdout


def commands(folder: Path, optimisation: str) -> dict[str, list[str]]:
    """How each file of the runtime is compiled for the verilated `folder`, by the file's name."""
    rule = "runtime: ; @echo $(VK_GLOBAL_OBJS); echo $(CXX) $(OPT_FAST) $(CXXFLAGS) $(CPPFLAGS)"
    objects, header = _make(folder, "--eval", rule, f"OPT_FAST={optimisation}", "runtime").splitlines()
    calls = [shlex.split(line) for line in _make(folder, "-n", "-B", *objects.split()).splitlines()]
    found = {call[call.index("-o") + 1]: call for call in calls if "-o" in call}
    compiled = f"{HEADER}.gch"
    return found | {compiled: [*shlex.split(header), "-x", "c++-header", "-o", compiled, HEADER]}


class RuntimeObjects:
    """Those of the simulator in a verilated `folder`, whose sources are compiled at `optimisation`."""

    def __init__(self, folder: Path, optimisation: str):
        self.folder, self.commands = folder, commands(folder, optimisation)
        compilers = [compiler_version(name) for name in sorted({call[0] for call in self.commands.values()})]
        content = repr((sorted(self.commands.items()), compilers, verilator_version(), HEADERS))
        self.kept = CACHE / hashlib.sha256(content.encode()).hexdigest()[:24]

    def take(self) -> None:
        """Put them into the folder, compiled first where nobody has; make leaves what it finds there.

        Compiled and kept are all or none; processes that want the same ones wait for the first.
        """
        self.kept.parent.mkdir(parents=True, exist_ok=True)
        (self.folder / HEADER).write_text("".join(f"#include <{name}>\n" for name in HEADERS))
        with FileLock(f"{self.kept}.lock"):
            if not self.kept.is_dir():
                self._keep()
        for name in self.commands:
            target = self.folder / name
            target.unlink(missing_ok=True)
            if name.endswith(".gch"):  # 70 MB
                target.symlink_to((self.kept / name).resolve())
            else:
                shutil.copyfile(self.kept / name, target)

    def _keep(self) -> None:
        with tempfile.TemporaryDirectory(dir=self.kept.parent, ignore_cleanup_errors=True) as temporary:
            part = Path(temporary) / "part"
            part.mkdir()
            for name, command in self.commands.items():
                subprocess.run(command, cwd=self.folder, capture_output=True, check=True)
                shutil.copyfile(self.folder / name, part / name)
            part.rename(self.kept)
