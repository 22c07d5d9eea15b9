"""The shift that takes the light's drift out of each channel, followed from frame to frame."""

from amaranth import Module, Mux, Signal, signed, unsigned
from amaranth.lib import data, wiring
from amaranth.lib.wiring import In, Out

from fastac.models.integer.features import WIDTH
from fastac.models.integer.light_level import BRIGHTEST, DARKEST, SHIFT_LIMIT
from fastac.models.integer.words import signed_width

SHIFT_WIDTH = signed_width(SHIFT_LIMIT)


def is_lit(background):
    """Whether a background, unsigned(8), is lit, as `models.integer.light_level.lit` says."""
    return (background >= DARKEST) & (background <= BRIGHTEST)


class LightFollower(wiring.Component):
    """Count the lit values above and below the background, and move each channel's shift towards the median.

    Bit-exact to `models.integer.light_level.next_shift`. It stands beside a pipeline, all of whose registers
    have the clock enable `advance`.

    Members
    -------
    advance : clock enable
    begins : a frame's first beat comes to where it is shifted with the next clock; from then on `shift` is
        this frame's
    counts : there is a beat of features, of a row other than the frame's last
    features : ΔI of `channels` for `lanes` pixels, signed(9) each, after the shift
    lit : which of them have a lit background
    shift : of each channel, signed(7), −63 … 63; 0 after a reset

    `latency` = 2 clocks from the last beat that counts to the `begins` that uses it: a register of the beat's
    sums, and one of the frame's. So a frame's last row must have at least 4 beats where `begins` comes two
    clocks before a beat's features.
    """

    latency = 2

    def __init__(self, height: int, width: int, channels: int, *, lanes: int):
        self.height, self.width, self.channels, self.lanes = height, width, channels, lanes
        features = data.ArrayLayout(signed(WIDTH), channels)
        super().__init__(
            {
                "advance": In(1),
                "begins": In(1),
                "counts": In(1),
                "features": In(data.ArrayLayout(features, lanes)),
                "lit": In(data.ArrayLayout(unsigned(channels), lanes)),
                "shift": Out(data.ArrayLayout(signed(SHIFT_WIDTH), channels)),
            }
        )

    def _majority(self, m: Module, name: str, votes: list, voters: list) -> Signal:
        """Whether over the frame more than half of the `voters` have a vote; both one bit a lane."""
        beat = Signal(signed(signed_width(self.lanes)), name=f"{name}_beat")
        largest = (self.height - 1) * self.width
        frame = Signal(signed(signed_width(largest)), name=f"{name}_frame")
        counted = sum(
            (Mux(voter, Mux(vote, 1, -1), 0) for vote, voter in zip(votes, voters, strict=True)), start=0
        )
        with m.If(self.advance):
            m.d.sync += [
                beat.eq(Mux(self.counts, counted, 0)),
                frame.eq(Mux(self.begins, 0, frame + beat)),
            ]
        return frame > 0

    def elaborate(self, platform):
        m = Module()
        for channel in range(self.channels):
            values = [feature[channel] for feature in self.features]
            voters = [lit[channel] for lit in self.lit]
            above = self._majority(m, f"above_{channel}", [value > 0 for value in values], voters)
            below = self._majority(m, f"below_{channel}", [value < 0 for value in values], voters)
            shift = Signal(signed(SHIFT_WIDTH), name=f"shift_{channel}")
            m.d.comb += self.shift[channel].eq(shift)
            with m.If(self.advance & self.begins):
                with m.If(above & (shift != SHIFT_LIMIT)):
                    m.d.sync += shift.eq(shift + 1)
                with m.Elif(below & (shift != -SHIFT_LIMIT)):
                    m.d.sync += shift.eq(shift - 1)
        return m


def shifted(pixel, shift, lit):
    """A pixel, unsigned(8), less a shift where it is lit and not clipped, within 0 … 255, as in
    `models.integer.light_level.shifted`."""
    moved = pixel - shift
    clipped = (pixel == 0) | (pixel == 255)
    within = Mux(moved < 0, 0, Mux(moved > 255, 255, moved))
    return Mux(lit & ~clipped, within, pixel)
