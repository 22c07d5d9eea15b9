# amaranth: UnusedElaboratable=no
"""The spread of the touching dots, from the dots' shifts and the displacement of the skin."""

from amaranth import Module
from amaranth.lib import wiring
from amaranth.lib.wiring import In, Out, connect

from fastac.gateware.slip.contact import DotContact
from fastac.gateware.slip.rigid_sums import RigidSums
from fastac.gateware.slip.spread_ratio import SpreadRatio
from fastac.gateware.stream.tables import RecordTable
from fastac.models.integer.dot_spread import DotSpread
from fastac.models.integer.pipeline import IntegerPipeline


class DotSlip(wiring.Component):
    """Find the spread of each frame's touching dots, bit-exact to `pipeline.spread(…)`.

    Members
    -------
    dots : stream of one dot per beat, see `dot_layout`
    displacement : stream of `lanes` displacements, see `Displacement.o`
    o : stream of one beat per frame, see `spread_layout`
    contact_places, rigid_places : write ports, see `DotContact` and `RigidSums`. Only if
        `pipeline.follower.loadable`.

    `latency` counts from what comes later, a frame's last displacements or its last dot, to its spread:
    contact, sums and ratio.
    """

    def __init__(self, pipeline: IntegerPipeline, displacement, *, lanes: int, rows_reversed: bool):
        self.pipeline = pipeline
        spread, rows = pipeline.spread, pipeline.scene.inner_px
        self.contact = DotContact(spread, displacement, rows=rows, lanes=lanes, rows_reversed=rows_reversed)
        self.sums = RigidSums(spread, pipeline.follower, self.contact.order)
        self.ratio = SpreadRatio(spread)
        members = {
            "dots": In(self.sums.dots.signature.flip()),
            "displacement": In(self.contact.i.signature.flip()),
            "o": Out(self.ratio.o.signature),
        }
        self.loadable = pipeline.follower.loadable
        if self.loadable:
            members |= {name: In(table.format.signature) for name, table in self.tables.items()}
        super().__init__(members)

    @property
    def tables(self) -> dict[str, RecordTable]:
        """What is known of the dots, by the name of its write port."""
        return {"contact_places": self.contact.table, "rigid_places": self.sums.table}

    @staticmethod
    def latency_of(spread: DotSpread) -> int:
        count = len(spread.place)
        return DotContact.latency + RigidSums.latency_of(count) + SpreadRatio.latency_of(spread)

    @property
    def latency(self) -> int:
        return self.latency_of(self.pipeline.spread)

    @classmethod
    def interval_of(cls, spread: DotSpread) -> int:
        """Clocks from a frame's contact to the next one's: the sums stay until the ratio is found."""
        return cls.latency_of(spread) - DotContact.latency

    @property
    def interval(self) -> int:
        return self.interval_of(self.pipeline.spread)

    @property
    def multipliers(self) -> int:
        return self.sums.multipliers

    def elaborate(self, platform):
        m = Module()
        m.submodules.contact = contact = self.contact
        m.submodules.sums = sums = self.sums
        m.submodules.ratio = ratio = self.ratio
        connect(m, wiring.flipped(self.dots), sums.dots)
        connect(m, wiring.flipped(self.displacement), contact.i)
        connect(m, contact.o, sums.contact)
        connect(m, sums.o, ratio.i)
        connect(m, ratio.o, wiring.flipped(self.o))
        if self.loadable:
            connect(m, wiring.flipped(self.contact_places), contact.write)
            connect(m, wiring.flipped(self.rigid_places), sums.write)
        return m
