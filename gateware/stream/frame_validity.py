# amaranth: UnusedElaboratable=no
"""Plausibility flags of every frame, measured beside the datapath without stalling or delaying it."""

from collections.abc import Sequence

import numpy as np
from amaranth import Cat, Const, Module, Mux, Signal, signed, unsigned
from amaranth.lib import data, fifo, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.frame_sum import FrameAccumulator, beats_per_frame, tree_levels
from fastac.gateware.stream.frame_guard import FRAMES_IN_FLIGHT
from fastac.models.integer import frame_validity as model
from fastac.models.integer.features import WIDTH

DOTS_LATENCY = 4
"""Clocks from a frame's last dot to what its verdict waits for: input register, sum, comparison and FIFO."""


def by_stage(measures: Sequence[str]) -> dict[str, list[str]]:
    """Measures of pixels, in their order, by the stage with whose last beat they are complete."""
    groups = {"features": [], "slopes": []}
    for name in measures:
        groups["slopes" if name == "gradient" else "features"].append(name)
    return {stage: names for stage, names in groups.items() if names}


class FrameValidity(wiring.Component):
    """Compare measures of each frame with limits; flags bit-exact to `models.integer.frame_validity`.

    Members
    -------
    pixels, pixels_taken : `lanes` pixels of C × unsigned(8), and whether this beat moves in this clock
    features, features_taken : the same for the features after the background subtraction: `lanes` vectors of
        C differences ΔI and 2 coordinates, signed(9) each
    slopes_over, slopes_taken : one bit for each of `lanes` × 2 slopes: it saturates. Only with
        `validity.slopes`.
    displacements_over, displacements_taken : one bit for each of `lanes` displacements: it saturates; rows of
        ceil(N/lanes) beats. Only with `validity.displacements`.
    dot_lost, dot_taken : one bit for one dot: it is lost; `validity.dots` of them a frame. Only with dots.
    suspect_valid, suspect : `suspect_valid` pulses once per frame, after its last slopes (without slopes: its
        last features); `suspect` then tells whether any flag is set, except those for displacements and dots,
        which are not known yet
    verdict : stream of one word of flags per frame, in order, bit k for REASONS[k]; a bit set means a measure
        is outside its limits
    limits : the word of `limits_image`, constant while a frame is in flight. Only with `loadable`.
    features_measures, features_measured : those measures in `measured` that are complete with a frame's
        features, a field each, and a pulse when they are, once per frame; the other two are of the slopes.
        They stay for a few clocks only. Only those that `measured` names any of.
    slopes_measures, slopes_measured : the same for the measure "gradient"

    All inputs are only observed. `latency` = 4 + ceil(log2(values per beat)) clocks from a frame's last beat
    at the last observed stage (displacements, else slopes, else features) to its `verdict`: input register,
    adder tree, sum, comparison and FIFO. Without displacements, `suspect_valid` comes a clock earlier. With
    dots `verdict` also waits until DOTS_LATENCY clocks after the frame's last dot. A stage's measures come
    `measured_latency` clocks after a frame's last beat there.
    """

    def __init__(
        self,
        validity: model.FrameValidity,
        *,
        lanes: int,
        loadable: bool = False,
        measured: Sequence[str] = (),
    ):
        self.validity, self.lanes, self.loadable = validity, lanes, loadable
        self.measured = by_stage(measured)
        self.height, self.width, self.channels = validity.shape
        pixel = data.ArrayLayout(unsigned(8), self.channels)
        features = data.ArrayLayout(signed(WIDTH), self.channels + 2)
        members = {
            "pixels": In(data.ArrayLayout(pixel, lanes)),
            "features": In(data.ArrayLayout(features, lanes)),
            "suspect_valid": Out(1),
            "suspect": Out(1),
            "verdict": Out(stream.Signature(len(model.REASONS))),
        }
        self.observed = ["pixels", "features"]
        if validity.slopes:
            self.observed.append("slopes")
            members["slopes_over"] = In(2 * lanes)
        if validity.displacements:
            self.observed.append("displacements")
            members["displacements_over"] = In(lanes)
        members |= {f"{name}_taken": In(1) for name in self.observed}
        if validity.dots:
            members |= {"dot_lost": In(1), "dot_taken": In(1)}
        if loadable:
            members["limits"] = In(self.limits_bits)
        for stage, names in self.measured.items():
            layout = data.StructLayout({name: signed(dict(self._measures)[name]) for name in names})
            members |= {f"{stage}_measures": Out(layout), f"{stage}_measured": Out(1)}
        super().__init__(members)

    @property
    def limits_bits(self) -> int:
        return sum(width * (1 + (name in model.TWO_SIDED)) for name, width in self._measures)

    @property
    def _measures(self):
        return zip(self.validity.names, self.validity.widths, strict=True)

    def limits_image(self, validity: model.FrameValidity) -> int:
        """The limits of `validity` in one word, from bit 0: of each measure `low`, if any, then `high`."""
        image, place = 0, 0
        for k, (name, width) in enumerate(self._measures):
            limits = (validity.low[k], validity.high[k]) if name in model.TWO_SIDED else (validity.high[k],)
            for limit in limits:
                image |= (int(limit) & ((1 << width) - 1)) << place
                place += width
        return image

    def _words(self, measure: str) -> int:
        """How many values of `measure` one beat contributes."""
        if measure in ("change", "detail"):
            return self.lanes * self.channels
        return 2 * self.lanes if measure == "gradient" else self.lanes

    @property
    def latency(self) -> int:
        """Input register, adder tree, accumulator, comparison and FIFO."""
        last = {"features": "change", "slopes": "gradient", "displacements": "displacement"}
        return 4 + tree_levels(self._words(last[self.observed[-1]]))

    @staticmethod
    def measured_latency(stage: str, channels: int, lanes: int) -> int:
        """Input register, adder tree, accumulator and the register of the measure."""
        return 3 + tree_levels(lanes * (channels if stage == "features" else 2))

    def elaborate(self, platform):
        m = Module()
        beats = beats_per_frame(self.height, self.width, self.lanes)
        limits = self.limits if self.loadable else Const(self.limits_image(self.validity), self.limits_bits)
        low, high, place = {}, {}, 0
        for name, width in self._measures:
            for table, wanted in ((low, name in model.TWO_SIDED), (high, True)):
                if wanted:
                    table[name] = limits[place : place + width].as_signed()
                    place += width

        def count(name: str, taken, values: list, largest: int, beats: int = beats):
            """Sum `values` over a frame; returns the registers (sum complete, sum outside its limits)."""
            bounds = np.full((beats, 1, len(values)), largest)
            m.submodules[f"{name}_count"] = counter = FrameAccumulator(bounds, np.zeros(1, np.int64))
            held = Signal(name=f"{name}_held")
            m.d.sync += held.eq(taken)
            m.d.comb += [counter.i.valid.eq(held), counter.o.ready.eq(1)]
            for k, (word, value) in enumerate(zip(counter.i.payload[0], values, strict=True)):
                register = Signal.like(word, reset_less=True, name=f"{name}_value_{k}")
                m.d.sync += register.eq(value)
                m.d.comb += word.eq(register)
            measure, done, beyond = counter.o.payload[0], Signal(name=f"{name}_done"), Signal(name=name)
            m.d.sync += done.eq(counter.o.valid)
            for stage, names in self.measured.items():
                if name in names:
                    kept = Signal.like(measure, reset_less=True, name=f"{name}_measure")
                    with m.If(counter.o.valid):
                        m.d.sync += kept.eq(measure)
                    m.d.comb += getattr(self, f"{stage}_measures")[name].eq(kept)
            with m.If(counter.o.valid):
                below = measure < low[name] if name in low else 0
                m.d.sync += beyond.eq(below | (measure > high[name]))
            return done, beyond

        flags = {}
        for name, values, largest in self._of_pixels(m):
            _, flags[name] = count(name, self.pixels_taken, values, largest)
        difference = [list(pixel)[: self.channels] for pixel in self.features]
        for c in range(self.channels):
            name = model.REASONS[1 + c]
            _, flags[name] = count(name, self.features_taken, [pixel[c] for pixel in difference], 255)
        magnitudes = [Mux(value < 0, -value, value) for pixel in difference for value in pixel]
        done, flags["change"] = count("change", self.features_taken, magnitudes, 255)
        if "features" in self.measured:
            m.d.comb += self.features_measured.eq(done)
        # The pixels' flags were set a few stages earlier; the next frame cannot have changed them yet.
        known = Cat(flags.get(name, 0) for name in model.REASONS)

        def join(stage: str, taken, over, beats: int):
            """Queue each frame's earlier flags until this stage's own flag is known, and add it."""
            m.submodules[f"{stage}_queue"] = queue = fifo.SyncFIFO(
                width=len(model.REASONS), depth=FRAMES_IN_FLIGHT
            )
            m.d.comb += [queue.w_data.eq(known), queue.w_en.eq(done)]
            stage_done, beyond = count(stage, taken, list(over), 1, beats)
            m.d.comb += queue.r_en.eq(stage_done)
            return stage_done, queue.r_data | beyond << model.REASONS.index(stage)

        if self.validity.slopes:
            done, known = join("gradient", self.slopes_taken, self.slopes_over, beats)
            if "slopes" in self.measured:
                m.d.comb += self.slopes_measured.eq(done)
        m.d.comb += [self.suspect_valid.eq(done), self.suspect.eq(known.any())]
        if self.validity.displacements:
            inner = beats_per_frame(self.height - 2, self.width - 2, self.lanes)
            over = self.displacements_over
            done, known = join("displacement", self.displacements_taken, over, inner)
        m.submodules.verdicts = verdicts = fifo.SyncFIFO(width=len(model.REASONS), depth=FRAMES_IN_FLIGHT)
        m.d.comb += [verdicts.w_data.eq(known), verdicts.w_en.eq(done)]
        found, ready = verdicts.r_data, verdicts.r_rdy
        taken = self.verdict.valid & self.verdict.ready
        m.d.comb += verdicts.r_en.eq(taken)
        if self.validity.dots:
            # Dots are known before or after all else, so they have a queue of their own.
            m.submodules.dot_flags = of_dots = fifo.SyncFIFO(width=1, depth=FRAMES_IN_FLIGHT)
            dots_done, beyond = count("dots", self.dot_taken, [self.dot_lost], 1, self.validity.dots)
            m.d.comb += [of_dots.w_data.eq(beyond), of_dots.w_en.eq(dots_done), of_dots.r_en.eq(taken)]
            found, ready = found | of_dots.r_data << model.REASONS.index("dots"), ready & of_dots.r_rdy
        m.d.comb += [self.verdict.valid.eq(ready), self.verdict.payload.eq(found)]
        return m

    def _of_pixels(self, m: Module):
        """The measures that need no background: (name, values of a beat, largest magnitude of a value)."""
        beats = self.width // self.lanes
        beat, before = Signal(range(beats)), Signal.like(self.pixels[0], reset_less=True)
        with m.If(self.pixels_taken):
            m.d.sync += [beat.eq(Mux(beat == beats - 1, 0, beat + 1)), before.eq(self.pixels[-1])]
        yield "clipped", [Cat((v == 0) | (v == 255) for v in pixel).any() for pixel in self.pixels], 1
        steps = []
        for k, pixel in enumerate(self.pixels):
            for c, value in enumerate(pixel):
                left = before[c] if k == 0 else self.pixels[k - 1][c]
                step = Mux(value < left, left - value, value - left)
                steps.append(Mux(beat == 0, 0, step) if k == 0 else step)
        yield "detail", steps, 255
