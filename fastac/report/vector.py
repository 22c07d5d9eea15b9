"""Matplotlib's figures as SVG inside a page: sharp at any size, and in the page's own text colour."""

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager

import matplotlib
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator, MaxNLocator, NullLocator

from fastac.report.log_ticks import log_ticks

INK = "#010203"
"""Colour of text and axes while a figure is drawn: `inline_svg` gives them the page's text colour."""
STYLE = {
    "svg.fonttype": "none",
    "svg.hashsalt": "fastac",
    "text.color": INK,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.15,
    "grid.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "axes.titlesize": 10,
    "axes.labelsize": 9,
    "xtick.labelsize": 9,
    "ytick.labelsize": 9,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
}
_NOT_IN_PAGES = re.compile(r"<metadata>.*?</metadata>|\sxmlns(:xlink)?=\"[^\"]*\"", re.DOTALL)
DECADE = 10
"""An axis over less than this ratio is linear: a logarithmic one would have too few labels."""


@contextmanager
def drawing(width_in: float, height_in: float, rows: int = 1, **more) -> Iterator[tuple[Figure, object]]:
    """A figure and its axes in the style of the pages; `more` as of `Figure.subplots`."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(width_in, height_in), layout="constrained")
        yield figure, figure.subplots(rows, **more)


def inline_svg(figure: Figure) -> str:
    """The `<svg>` element of a figure from `drawing`, for a page: it loads nothing and names no address."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    text = buffer.getvalue()
    text = _NOT_IN_PAGES.sub("", text[text.index("<svg") :]).replace("xlink:href", "href")
    return text.replace(INK, "currentColor").strip()


def readable_scale(axis: Axis, low: float, high: float) -> None:
    """Logarithmic over more than a decade, else linear; few labels, all legible."""
    if low > 0 and high > DECADE * low:
        readable_log(axis, low, high)
        return
    (axis.axes.set_xscale if axis.axis_name == "x" else axis.axes.set_yscale)("linear")
    axis.set_major_locator(MaxNLocator(5))


def readable_log(axis: Axis, low: float, high: float) -> None:
    """A logarithmic axis with few, legible labels from `low` to `high`; its limits stay what they are."""
    (axis.axes.set_xscale if axis.axis_name == "x" else axis.axes.set_yscale)("log")
    places, labels = log_ticks(low, high)
    axis.set_major_locator(FixedLocator(places))
    axis.set_major_formatter(FixedFormatter(labels))
    axis.set_minor_locator(NullLocator())
