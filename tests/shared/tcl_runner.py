"""Tcl scripts run in a real Tcl interpreter whose foreign commands are answered by Python."""

import base64
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

PREFIX = "\x01call"
STUBS = r"""
proc ask {name arguments} {
    set words {}
    foreach word [list $name {*}$arguments] {
        lappend words [binary encode base64 [encoding convertto utf-8 $word]]
    }
    puts stdout "\x01call [join [lmap word $words {expr {$word eq "" ? "-" : $word}}]]"
    flush stdout
    gets stdin line
    lassign $line state answer
    set answer [encoding convertfrom utf-8 [binary decode base64 $answer]]
    if {$state eq "error"} {
        return -code error $answer
    }
    return $answer
}
foreach name [split [gets stdin] " "] {
    proc $name {args} "ask $name \$args"
}
set argv [split [gets stdin] " "]
set argc [llength $argv]
set script [gets stdin]
info script $script
source $script
"""
TKINTER = "import sys, tkinter; tkinter.Tcl().eval(open(sys.argv[1]).read())"


class TclError(Exception):
    """What a command answers as an error."""


def interpreter() -> list[str] | None:
    """The command of a Tcl interpreter: tclsh, or the one inside Python's tkinter; None without both."""
    if tclsh := shutil.which("tclsh"):
        return [tclsh]
    try:
        import tkinter

        tkinter.Tcl()
    except (ImportError, RuntimeError):
        return None
    return [sys.executable, "-c", TKINTER]


def run(
    script: Path,
    arguments: Iterable[str],
    commands: Iterable[str],
    answer: Callable[[list[str]], str],
    folder: Path,
) -> tuple[int, str]:
    """Source `script` in `folder`; returns its exit status, and what it and Tcl printed.

    commands : names that are defined as procedures, each of whose calls `answer` is given as its words; what
        it returns is the result, and TclError is an error in Tcl
    """
    stubs = folder / "stubs.tcl"
    stubs.write_text(STUBS)
    process = subprocess.Popen(
        [*interpreter(), str(stubs)],
        cwd=folder,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    printed = []
    with process:
        for line in (" ".join(commands), " ".join(arguments), str(script)):
            process.stdin.write(line + "\n")
        process.stdin.flush()
        for line in process.stdout:
            if not line.startswith(PREFIX):
                printed.append(line)
                continue
            words = ["" if word == "-" else _decoded(word) for word in line.split()[1:]]
            try:
                state, text = "ok", answer(words)
            except TclError as error:
                state, text = "error", str(error)
            process.stdin.write(f"{state} {base64.b64encode(text.encode()).decode()}\n")
            process.stdin.flush()
    return process.returncode, "".join(printed)


def _decoded(word: str) -> str:
    return base64.b64decode(word).decode()
