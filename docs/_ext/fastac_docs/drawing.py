"""A block diagram as SVG, whose colours are the page's, in light and in dark."""

from html import escape

from fastac_docs.graph import Block, Graph, Stream
from fastac_docs.layout import Layout, place

WIDTHS = {"component": 236, "buffer": 130, "fork": 10, "port": 110}
HEIGHTS = {"component": 58, "buffer": 24, "fork": 10, "port": 26}
GAP_PX, LANE_PX, MARGIN_PX = 26, 120, 12
FALL_PX = 34
"""From one layer to the next."""
CHARACTER_PX = 6.5
"""Of the words beside a stream, at most."""
STRAIGHT_PX = 5
"""A stream that goes farther to the right has its words on its left."""


def svg(graph: Graph, *, label: str) -> str:
    """The diagram as an <svg> element without blank lines, so that Markdown takes it as one block.

    label : what readers who do not see it are told
    """
    blocks = {block.name: block for block in graph.blocks}
    layout = place(
        {name: WIDTHS[block.kind] for name, block in blocks.items()},
        [(stream.source, stream.target) for stream in graph.streams],
        gap=GAP_PX,
        lane=LANE_PX,
    )
    tops, bottoms = _levels(layout, blocks)
    labels = [_label(stream, graph, layout, tops, bottoms) for stream in graph.streams]
    right = [x + CHARACTER_PX * len(text) for x, _, text, left in labels if not left]
    right += [MARGIN_PX + layout.centre[name] + WIDTHS[block.kind] / 2 for name, block in blocks.items()]
    begin = min([0.0, *(x - CHARACTER_PX * len(text) - MARGIN_PX for x, _, text, left in labels if left)])
    width = max(right) + MARGIN_PX - begin
    height = bottoms[-1] + MARGIN_PX
    parts = [
        f'<svg class="block-diagram" viewBox="{begin:.0f} 0 {width:.0f} {height:.0f}" width="{width:.0f}"'
        f' role="img" aria-label="{escape(label)}" xmlns="http://www.w3.org/2000/svg">',
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7"'
        ' orient="auto"><path d="M0,0.5 L8,4 L0,7.5 z"/></marker></defs>',
    ]
    parts += _groups(layout, blocks, tops, bottoms)
    parts += [_arrow(stream, layout, blocks, tops, bottoms) for stream in graph.streams]
    parts += [
        f'<text class="words{" left" if left else ""}" x="{x:.1f}" y="{y:.1f}">{escape(text)}</text>'
        for x, y, text, left in labels
        if text
    ]
    middles = {name: (tops[k] + bottoms[k]) / 2 for k, layer in enumerate(layout.layers) for name in layer}
    parts += [_box(block, MARGIN_PX + layout.centre[name], middles[name]) for name, block in blocks.items()]
    return "\n".join([*parts, "</svg>"])


def _levels(layout: Layout, blocks: dict[str, Block]) -> tuple[list[float], list[float]]:
    """Top and bottom of each layer, in px."""
    tops, bottoms, y = [], [], float(MARGIN_PX)
    for layer in layout.layers:
        tops.append(y)
        y += max((HEIGHTS[blocks[name].kind] for name in layer if name in blocks), default=HEIGHTS["fork"])
        bottoms.append(y)
        y += FALL_PX
    return tops, bottoms


def _groups(layout: Layout, blocks, tops, bottoms) -> list[str]:
    """A frame around the parts of each component that is drawn by its parts."""
    found: dict[str, list[tuple[float, float, float, float]]] = {}
    for k, layer in enumerate(layout.layers):
        for name in layer:
            if name in blocks and "." in name:
                half, x = WIDTHS[blocks[name].kind] / 2, MARGIN_PX + layout.centre[name]
                box = (x - half, tops[k], x + half, bottoms[k])
                found.setdefault(name.split(".")[0], []).append(box)
    parts = []
    for name, boxes in found.items():
        left, top = min(b[0] for b in boxes) - 8, min(b[1] for b in boxes) - 8
        right, bottom = max(b[2] for b in boxes) + 8, max(b[3] for b in boxes) + 8
        parts.append(
            f'<g class="group"><rect x="{left:.0f}" y="{top:.0f}" width="{right - left:.0f}"'
            f' height="{bottom - top:.0f}" rx="8"/>'
            f'<text x="{left + 8:.0f}" y="{top - 5:.0f}">{escape(name)}</text></g>'
        )
    return parts


def _arrow(stream: Stream, layout: Layout, blocks, tops, bottoms) -> str:
    """A stream as a line that is vertical in the layers that it passes, with its words at its end."""
    way = layout.ways[stream.source, stream.target]
    rank = {name: k for k, layer in enumerate(layout.layers) for name in layer}
    x = [MARGIN_PX + layout.centre[name] for name in way]
    middle = [(tops[rank[name]] + bottoms[rank[name]]) / 2 for name in way]
    half = [HEIGHTS[blocks[name].kind] / 2 if name in blocks else None for name in way]
    path, y = f"M{x[0]:.1f},{middle[0] + half[0]:.1f}", middle[0] + half[0]
    for k in range(1, len(way)):
        layer = rank[way[k]]
        end = tops[layer] if half[k] is None else middle[k] - half[k]
        start = bottoms[layer - 1]
        bend = (start + tops[layer]) / 2
        path += f" L{x[k - 1]:.1f},{start:.1f}" if start > y else ""
        path += f" C{x[k - 1]:.1f},{bend:.1f} {x[k]:.1f},{bend:.1f} {x[k]:.1f},{tops[layer]:.1f}"
        path += f" L{x[k]:.1f},{end:.1f}" if end > tops[layer] else ""
        y = end
    tip = "" if blocks[stream.target].kind == "fork" else ' marker-end="url(#tip)"'
    return f'<path class="stream" d="{path}"{tip}/>'


def _label(stream: Stream, graph: Graph, layout: Layout, tops, bottoms) -> tuple[float, float, str, bool]:
    """Where a stream's words are written, x and y, the words, and whether they end there.

    Beside its beginning, or beside its end where more than one stream begins there. What leaves a fork is
    what goes in, where it is written already.
    """
    blocks = {block.name: block for block in graph.blocks}
    if blocks[stream.source].kind == "fork":
        return 0.0, 0.0, "", False
    rank = {name: k for k, layer in enumerate(layout.layers) for name in layer}
    x = [MARGIN_PX + layout.centre[name] for name in layout.ways[stream.source, stream.target]]
    alone = sum(other.source == stream.source for other in graph.streams) == 1
    ends = (stream.source, 0, 1, 13) if alone else (stream.target, -1, -1, -11)
    name, end, side, shift = ends
    layer, half = rank[name], HEIGHTS[blocks[name].kind] / 2
    y = (tops[layer] + bottoms[layer]) / 2 + side * half + shift
    left = (x[1] - x[0] if alone else x[-2] - x[-1]) > STRAIGHT_PX
    return x[end] + (-8 if left else 8), y, stream.words, left


def _box(block: Block, x: float, y: float) -> str:
    """A block around the place x, y."""
    width, height = WIDTHS[block.kind], HEIGHTS[block.kind]
    if block.kind == "fork":
        return f'<g class="fork"><circle cx="{x:.1f}" cy="{y:.1f}" r="{width / 2}"/></g>'
    left, top = x - width / 2, y - height / 2
    corner = height / 2 if block.kind == "port" else 5
    shape = (
        f'<rect x="{left:.1f}" y="{top:.1f}" width="{width}" height="{height}" rx="{corner:g}"/>'
        f"<title>{escape(block.note or f'{block.title}: a stream of the datapath')}</title>"
    )
    if block.kind == "port":
        texts = [("name", 4, block.title)]
    elif block.kind == "buffer":
        texts = [("figures", 4, f"buffer, {_clocks(block.latency)}")]
    else:
        figures = [_clocks(block.latency)] if block.latency is not None else []
        figures += [f"{block.multipliers} DSP"] if block.multipliers else []
        texts = [
            ("name", -12, block.title),
            ("file", 4, block.file.removeprefix("gateware/")),
            ("figures", 20, ", ".join(figures)),
        ]
    lines = "".join(
        f'<text class="{kind}" x="{x:.1f}" y="{y + shift:.1f}">{escape(text)}</text>'
        for kind, shift, text in texts
    )
    return f'<g class="{block.kind}">{shape}{lines}</g>'


def _clocks(latency: int) -> str:
    return f"{latency} clock{'' if latency == 1 else 's'}"
