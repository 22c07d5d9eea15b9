"""Verilator's own runtime, compiled once instead of for every simulator.

It is the same for all simulators with the same flags, and takes most of the time that a small one needs.
"""

import hashlib
import os
import shlex
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

CACHE = Path("build/cache/verilator")
"""Objects by the hash of the compiler and the commands that make them."""
MAKEFILE = "Vtop.mk"


@cache
def compiler_version(compiler: str) -> str:
    return subprocess.run([compiler, "--version"], capture_output=True, text=True, check=True).stdout


def commands(folder: Path) -> dict[str, list[str]]:
    """How make would compile each object of the runtime, by its name, in the verilated `folder`."""

    def make(*arguments: str) -> str:
        call = ["make", "--no-print-directory", "-C", str(folder), "-f", MAKEFILE, *arguments]
        return subprocess.run(call, capture_output=True, text=True, check=True).stdout

    objects = make("--eval", "runtime-objects: ; @echo $(VK_GLOBAL_OBJS)", "runtime-objects").split()
    calls = [shlex.split(line) for line in make("-n", "-B", *objects).splitlines()]
    return {call[call.index("-o") + 1]: call for call in calls if "-o" in call}


class RuntimeObjects:
    """Those of the simulator in a verilated `folder`: taken before make runs, kept after it."""

    def __init__(self, folder: Path):
        self.folder, found = folder, commands(folder)
        self.names = sorted(found)
        compilers = [compiler_version(name) for name in sorted({call[0] for call in found.values()})]
        # The include folder is Verilator's own, and a package that changes has another version there.
        version = (Path(os.environ["VERILATOR_ROOT"]) / "include" / "verilated_config.h").read_text()
        content = repr((sorted(found.items()), compilers, version))
        self.kept = CACHE / hashlib.sha256(content.encode()).hexdigest()[:24]

    def take(self) -> None:
        """Copy what is there; make finds it newer than its sources and leaves it."""
        if self.kept.is_dir():
            for name in self.names:
                shutil.copyfile(self.kept / name, self.folder / name)

    def keep(self) -> None:
        """Copy what make compiled, all of it or nothing, even where others do so at the same time."""
        if self.kept.is_dir():
            return
        self.kept.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=self.kept.parent, ignore_cleanup_errors=True) as temporary:
            part = Path(temporary) / "part"
            part.mkdir()
            for name in self.names:
                shutil.copyfile(self.folder / name, part / name)
            try:
                part.rename(self.kept)
            except OSError:
                if not self.kept.is_dir():
                    raise
