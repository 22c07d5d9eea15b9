"""Matplotlib's figures as PNG: in a file, or inside a page that needs no other file.

Nothing in the reports chooses Matplotlib's backend: a notebook that imports them still shows its own
figures.
"""

import base64
import io
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from fastac.store.files import write_atomically

DPI = 110


def save_png(figure: Figure, path: Path, *, dpi: int = DPI) -> None:
    """Write a figure and close it; the file appears whole or not at all."""
    with write_atomically(path) as temporary:
        figure.savefig(temporary, format="png", dpi=dpi, bbox_inches="tight")
    plt.close(figure)


def base64_png(figure: Figure | Path) -> str:
    """A figure, which is closed, or a PNG file as base64, for `<img src="data:image/png;base64,…">`."""
    if isinstance(figure, Path):
        return base64.b64encode(figure.read_bytes()).decode()
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, bbox_inches="tight")
    plt.close(figure)
    return base64.b64encode(buffer.getvalue()).decode()
