# amaranth: UnusedElaboratable=no
"""The block diagram of a datapath, read from the hardware: its components and the streams between them.

Nothing is listed by hand: the components elaborate, and each `connect` of two streams is noted.
"""

import sys
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

from amaranth import Shape
from amaranth.lib import data, stream, wiring

from fastac.gateware.datapath import Datapath
from fastac.gateware.stream.fork import Fork
from fastac.gateware.stream.queues import SkidBuffer
from fastac.models.integer.pipeline import IntegerPipeline

ROOT = Path(__file__).resolve().parents[3]
EXPANDED = ("solver",)
"""Components whose parts are drawn in their place."""
CONNECTING = ("fastac.gateware.poisson.stages", "fastac.gateware.stream.fork")
"""Modules whose functions connect streams for a component."""


@dataclass(frozen=True)
class Block:
    """A box of the diagram.

    name : of the component in its parent; parts of another component have its name before a dot
    kind : "component", "buffer", "fork" or "port", a stream of the whole datapath
    note : what the class is for, the first line of its docstring
    file : where the class is, from the root of the repository; "" for ports
    latency : clocks, None where it has no such figure; multipliers : DSP slices, 0 if none
    """

    name: str
    kind: str
    title: str
    note: str = ""
    file: str = ""
    latency: int | None = None
    multipliers: int = 0


@dataclass(frozen=True)
class Stream:
    """An arrow: a stream from one block to another, by their names, and its words."""

    source: str
    target: str
    words: str


@dataclass(frozen=True)
class Graph:
    blocks: tuple[Block, ...]
    streams: tuple[Stream, ...]

    def block(self, name: str) -> Block:
        """Raises KeyError where there is none."""
        return {block.name: block for block in self.blocks}[name]


def datapath_graph(pipeline: IntegerPipeline) -> Graph:
    """The blocks and streams of the pipeline's datapath, from its input `axis` to its outputs.

    Streams alone are drawn: write ports of calibrations, flags and counters are signals or no streams.
    """
    datapath = Datapath(pipeline)
    found = _Recorder()
    found.read(datapath, "")
    return found.graph()


def words_of(shape) -> str:
    """A payload's shape as a person writes it: "4 × 2 × signed 17"."""
    if isinstance(shape, data.ArrayLayout):
        return f"{shape.length} × {words_of(shape.elem_shape)}"
    if isinstance(shape, data.StructLayout):
        return ", ".join(f"{name} {words_of(field.shape)}" for name, field in shape)
    if isinstance(shape, data.Layout):
        return f"{shape.size} bits"
    shape = Shape.cast(shape)
    if shape.width == 1 and not shape.signed:
        return "1 bit"
    return f"{'signed' if shape.signed else 'unsigned'} {shape.width}"


class _Recorder:
    """Blocks and streams as they are found."""

    def __init__(self):
        self.blocks: dict[str, Block] = {}
        self.owners: dict[int, str] = {}
        """Block of each stream, by the identity of its interface."""
        self.pairs: list[tuple[object, object]] = []
        self.alive: list[object] = []

    def read(self, parent: wiring.Component, path: str) -> None:
        """Note the component's parts and the streams between them."""
        module, pairs = _elaborated(parent)
        self.pairs += pairs
        for name, (part, *_) in module._named_submodules.items():
            part._MustUse__used = True  # looked at, never elaborated: Amaranth shall not warn
            if not isinstance(part, wiring.Component):
                continue
            self.alive.append(part)
            full = f"{path}{name}"
            if name in EXPANDED:
                self._own(part, full, f"{full}:")
                self.read(part, f"{full}.")
                continue
            self.blocks[full] = _block(full, part)
            self._own(part, full)
        if not path:
            self._own_ports(parent)

    def _own(self, part: wiring.Component, name: str, prefix: str | None = None) -> None:
        """Note to which block each of the component's streams belongs."""
        for member, interface in _streams(part):
            self.owners[id(interface)] = name if prefix is None else f"{prefix}{member}"

    def _own_ports(self, datapath: wiring.Component) -> None:
        for member, interface in _streams(datapath):
            self.blocks[f":{member}"] = Block(f":{member}", "port", member)
            self.owners[id(interface)] = f":{member}"

    def graph(self) -> Graph:
        """What can be reached from the input, with the ports of expanded components taken away."""
        arrows = []
        for left, right in self.pairs:
            source, target = self.owners.get(id(left)), self.owners.get(id(right))
            if source is not None and target is not None:
                arrows.append((source, target, _words(left)))
        joints = {name for arrow in arrows for name in arrow[:2] if name not in self.blocks}
        for joint in joints:
            ((source, _, words),) = (a for a in arrows if a[1] == joint)
            after = [(source, target, words) for begin, target, _ in arrows if begin == joint]
            arrows = [a for a in arrows if joint not in a[:2]] + after
        reached, left = set(), [":axis"]
        while left:
            name = left.pop()
            if name not in reached:
                reached.add(name)
                left += [target for source, target, _ in arrows if source == name]
        blocks = tuple(block for name, block in self.blocks.items() if name in reached)
        return Graph(blocks, tuple(Stream(*arrow) for arrow in arrows if arrow[0] in reached))


def _elaborated(component: wiring.Component):
    """The component's module, and the pairs of streams (source, target) that it connects."""
    pairs = []

    def connect(m, *interfaces, **named):
        found = [_plain(interface) for interface in (*interfaces, *named.values())]
        if len(found) == 2 and all(_is_stream(interface) for interface in found):
            pairs.append(tuple(found))
        return real(m, *interfaces, **named)

    real = wiring.connect
    modules = {sys.modules[name] for name in (type(component).__module__, *CONNECTING)}
    patches = [patch.object(module, "connect", connect) for module in modules if hasattr(module, "connect")]
    for one in patches:
        one.start()
    try:
        return component.elaborate(None), pairs
    finally:
        for one in patches:
            one.stop()


def _plain(interface):
    """The interface itself where it was flipped to connect a component's own port."""
    return wiring.flipped(interface) if isinstance(interface, wiring.FlippedInterface) else interface


def _is_stream(interface) -> bool:
    return hasattr(interface, "tdata") or isinstance(getattr(interface, "signature", None), stream.Signature)


def _streams(component: wiring.Component):
    """(name, interface) of the component's streams, those of arrays of streams too."""
    for member in component.signature.members:
        value = getattr(component, member)
        for interface in value if isinstance(value, list | tuple) else (value,):
            interface = _plain(interface)
            if _is_stream(interface):
                yield member, interface


def _words(interface) -> str:
    if hasattr(interface, "tdata"):
        return f"{len(interface.tdata)} bits"
    return words_of(interface.signature.members["payload"].shape)


def _block(name: str, part: wiring.Component) -> Block:
    kind = {Fork: "fork", SkidBuffer: "buffer"}.get(type(part), "component")
    module = sys.modules[type(part).__module__]
    file = Path(module.__file__).resolve().relative_to(ROOT)
    latency = getattr(part, "latency", None)
    return Block(
        name=name,
        kind=kind,
        title=name.split(".")[-1].replace("_", " "),
        note=(type(part).__doc__ or "").split("\n")[0],
        file=str(file),
        latency=latency if isinstance(latency, int) else None,
        multipliers=getattr(part, "multipliers", 0),
    )
