"""Our docstrings as reStructuredText, for autodoc.

They are plain text: `code` in single backticks, blocks of code that are just indented, and lists such as

    frames : (H, W, C) uint8, channels B, G, R
    progress : whether to show a progress bar
        on standard error
"""

import re

ITEM = re.compile(r"^(\w[\w, …]*?) : (\S.*)$")
HEADING = re.compile(r"^(\w[\w ]*)\n-+$", re.MULTILINE)


def to_rst(lines: list[str]) -> list[str]:
    """The lines of a docstring, without their common indentation, as reStructuredText."""
    found: list[str] = []
    for block in _blocks(lines):
        found += [*_block(block), ""]
    return found


def _blocks(lines: list[str]) -> list[list[str]]:
    """Paragraphs: runs of lines without a blank one between them; code keeps the blank lines inside it."""
    blocks: list[list[str]] = []
    new = True
    for line in lines:
        if not line.strip():
            new = True
            continue
        if new and blocks and _indented([line]) and _indented(blocks[-1]):
            blocks[-1] += ["", line]
        elif new:
            blocks.append([line])
        else:
            blocks[-1].append(line)
        new = False
    return blocks


def _indented(block: list[str]) -> bool:
    return block[0].startswith(" ")


def _block(block: list[str]) -> list[str]:
    if block[0].startswith(">>> "):
        return block
    if _indented(block):
        language = "python" if any(re.search(r"\w\(|import |= ", line) for line in block) else "text"
        return [f".. code-block:: {language}", "", *(f"   {line}" if line else "" for line in block)]
    if len(block) == 2 and HEADING.match("\n".join(block)):
        return [f"**{block[0]}**"]
    return _text(block)


def _text(block: list[str]) -> list[str]:
    """A paragraph, whose lines of the form "name : text" become a list; what follows indented belongs to
    them."""
    found: list[str] = []
    inside = False
    for line in block:
        item = ITEM.match(line)
        if item:
            if not inside and found:
                found.append("")
            names = ", ".join(f"``{name.strip()}``" for name in item[1].split(","))
            found += [names, f"   {marked(item[2])}"]
            inside = True
        elif inside and line.startswith(" "):
            found.append(f"   {marked(line.strip())}")
        else:
            if inside:
                found.append("")
            inside = False
            found.append(marked(line))
    return found


def marked(line: str) -> str:
    """A line with its code in double backticks, and what reStructuredText would take for marks escaped."""
    parts = re.split(r"(`+[^`]+`+)", line)
    return "".join(
        f"``{part.strip('`')}``" + _apart(parts, k) if k % 2 else _escaped(part)
        for k, part in enumerate(parts)
    )


def _apart(parts: list[str], k: int) -> str:
    """What separates code from a letter right behind it, as in `word`s."""
    behind = parts[k + 1] if k + 1 < len(parts) else ""
    return "\\ " if re.match(r"\w", behind) else ""


def _escaped(text: str) -> str:
    return re.sub(r"(?<=\w)_(?=\W|$)|[*|]", lambda match: f"\\{match[0]}", text)
