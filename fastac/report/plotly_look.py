"""What Plotly's plots on our pages have in common: colours for light and dark pages, few buttons."""

INK, GRID = "#7d8794", "rgba(125, 135, 148, 0.25)"
"""Colours of text and of lines; readable on light and on dark pages."""
CLEAR = "rgba(0, 0, 0, 0)"
LAYOUT = {
    "template": "simple_white",
    "font": {"color": INK, "family": "system-ui, sans-serif"},
    "paper_bgcolor": CLEAR,
    "plot_bgcolor": CLEAR,
    "modebar": {"bgcolor": CLEAR, "color": GRID, "activecolor": INK},
}
AXIS = {"color": INK, "linecolor": INK, "tickcolor": INK, "gridcolor": GRID, "showgrid": True}
SPACE_AXIS = {"color": INK, "gridcolor": GRID, "backgroundcolor": CLEAR, "showbackground": False}
"""Of an axis in three dimensions."""


def config(*buttons: str) -> dict:
    """Settings of a plot on a page: it follows the page's width and has only these buttons."""
    return {"responsive": True, "displaylogo": False, "modeBarButtons": [list(buttons)]}
