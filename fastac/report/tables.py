"""Tables as they are shown on pages, in terminals and in log files."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from tabulate import tabulate

_NUMBER = re.compile(r"[-+±]?\d\S*( \w+)?")


def text_table(head: Sequence[object], rows: Iterable[Sequence[object]]) -> str:
    """Aligned columns as plain text: no lines, no colours, never cut, so that files hold it as well.

    Cells are shown as they are, None as nothing; a column of numbers, with or without units, is aligned to
    the right.
    """
    cells = [["" if cell is None else str(cell) for cell in row] for row in rows]
    numeric = [
        all(_NUMBER.fullmatch(cell) for cell in column if cell) and any(column)
        for column in zip(*cells, strict=True)
    ] or [False] * len(head)
    text = tabulate(
        cells,
        [str(name) for name in head],
        tablefmt="plain",
        disable_numparse=True,
        colalign=["right" if known else "left" for known in numeric],
        preserve_whitespace=True,
    )
    return "\n".join(line.rstrip() for line in text.splitlines())


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table for Markdown pages; cells may hold Markdown."""
    return tabulate(list(rows), head, tablefmt="pipe", disable_numparse=True)


@dataclass(frozen=True)
class Table:
    """A table with its title and a note: rows of cells that are text already."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""

    @property
    def text(self) -> str:
        """The title and below it the indented table, for a terminal."""
        lines = text_table(self.head, self.rows).splitlines()
        return "\n".join([self.title, *(f"  {line}" for line in lines)])


def number(value) -> str:
    """Four significant digits, or all digits of a whole number with separators of thousands."""
    if isinstance(value, float) and not value.is_integer():
        return f"{value:.4g}"
    return f"{value:,.0f}" if isinstance(value, int | float) and not isinstance(value, bool) else str(value)


def mean_and_spread(values: Iterable[float], digits: int | None = None, sign: str = "") -> str:
    """The mean ± the standard deviation, as of a sample; of one value alone, the value.

    digits : behind the point; None: as `number` has them
    sign : "+" writes the mean's sign where it is positive, too
    """
    every = np.array(list(values), float)

    def text(value: float, sign: str = "") -> str:
        return number(float(value)) if digits is None else f"{value:{sign}.{digits}f}"

    mean = text(every.mean(), sign)
    return mean if len(every) == 1 else f"{mean} ± {text(every.std(ddof=1))}"
