"""The commands in the README and in docs/, as lines of shell and as pieces of code in sentences."""

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
OURS = re.compile(r"^(?:\$ )?(?:(?:\S*/)?bin/)?(fastac|make)(?= |$)")
NEEDS = re.compile(r"^<!-- needs: (.+?) -->$")


@dataclass(frozen=True)
class Documented:
    """One command of ours: where it stands, its words, and what it needs that tests do not have, "" if
    nothing."""

    page: str
    line: int
    words: tuple[str, ...]
    needs: str = ""

    @property
    def text(self) -> str:
        """The command as it is typed, from its name on."""
        return shlex.join(self.words).replace("'", "")

    def __str__(self) -> str:
        return f"{self.page}:{self.line}: {self.text}"


def shell_lines(page: Path) -> list[Documented]:
    """The commands in a page's blocks of code, fenced or indented, continued lines joined."""
    found = []
    for number, block, needs in _blocks(page.read_text(encoding="utf-8")):
        joined = re.sub(r"\\\n\s*", " ", "\n".join(block))
        for line in joined.splitlines():
            for part in re.split(r"&&|;|\|(?!\|)", re.sub(r"(^|\s)#.*", "", line)):
                ours = OURS.match(part.strip())
                if ours:
                    words = (ours[1], *_split(part.strip()[ours.end() :]))
                    found.append(Documented(page.name, number, words, needs))
    return found


def in_sentences(page: Path) -> list[Documented]:
    """The pieces of code outside blocks that begin with our command's or make's name."""
    found = []
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        for code in re.findall(r"`([^`]+)`", line):
            ours = OURS.match(code)
            if ours and not line.startswith("    "):
                words = (ours[1], *_split(code[ours.end() :].replace("\\|", "|")))
                found.append(Documented(page.name, number, words))
    return found


def _split(text: str) -> list[str]:
    try:
        return shlex.split(text)
    except ValueError:  # an apostrophe in what is a sentence
        return text.split()


def _blocks(text: str):
    """(line, lines, needs) of each block of code; `needs`: what a comment right above it says."""
    lines = text.splitlines()
    fence, block, needs, start = "", [], "", 0
    for number, line in enumerate([*lines, ""], 1):
        if fence:
            if line.strip() == fence:
                yield start, block, needs
                fence, block = "", []
            else:
                block.append(line)
            continue
        opened = re.match(r"^(```+)", line)
        if block and (opened or (line.strip() and not line.startswith("    "))):
            yield start, block, needs
            block = []
        if opened:
            fence, start = opened[1], number
        elif line.startswith("    "):
            start = start if block else number
            block.append(line.strip())
        if line.strip() and not line.startswith("    ") and not fence:
            comment = NEEDS.match(line)
            needs = comment[1] if comment else ""
    if block:
        yield start, block, needs
