# amaranth: UnusedElaboratable=no
"""The force from patches of a frame that comes slowly: patches times kernels by a few multipliers."""

import numpy as np
from amaranth import Cat, Module, Shape, Signal, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.dsp_slice import DSP48E2, DspSlice
from fastac.gateware.force.patch_generator import PatchGenerator, check_patch_size
from fastac.gateware.force.shared_accumulator import SharedAccumulator
from fastac.gateware.force.shared_products import (
    SharedProducts,
    products_latency,
    shared_multipliers,
)
from fastac.gateware.stream.handshake import check_folded
from fastac.models.integer.force import PatchForce

BORDER_CLOCKS = 3
"""Of the patch generator after the last beat that a patch needs."""


class FoldedPatchForce(wiring.Component):
    """Sum the responses of a displacement frame, A = Σ_p f(p), as `force(q)` does, a pixel in `fold` clocks.

    Members
    -------
    i : stream of one displacement per beat, Shape(force.displacement_bits, force.signed). A frame is N · N
        beats. A signed displacement must not be the most negative word. After a beat `ready` is low for
        fold − 1 clocks.
    o : stream of one beat per frame: one accumulator per axis, signed(force.width)
    map : stream of axes × 1 responses f(p), signed(force.pixel_width), bit-exact to `force.force_map(q)`;
        N · N beats in raster order. Only if `wants_map`.

    `latency` = fold · ((K//2)·N + K//2) + 9 + ceil(log2(multipliers)) + slots − 1 clocks from a frame's last
    input beat to its force, without back-pressure: the patches' look-ahead at `fold` clocks a patch, 3 for
    the patch generator, 5 and an adder tree for the products of a slot, 1 for the accumulator, and one clock
    for each slot before a pixel's last (`shares_of` says which products are found in which slot). A response
    leaves as late: `map_latency` is the same. Initiation interval: `interval` = fold · N² clocks per frame;
    what `PatchGenerator` says about the end of the previous frame applies here too. A force or map beat that
    is not taken stalls the whole pipeline before it.
    """

    def __init__(self, force: PatchForce, *, fold: int, wants_map: bool = False, dsp: DspSlice = DSP48E2):
        check_folded(fold)
        shape = force.kernel.shape
        if len(shape) != 5 or shape[1] != shape[2] or shape[3] != shape[4]:
            raise ValueError(f"kernel {shape}: expected (axes, N, N, K, K)")
        check_patch_size(shape[1], force.size, force.displacement_bits, 1)
        self.force, self.fold, self.size, self.wants_map, self.dsp = force, fold, shape[1], wants_map, dsp
        self.axes = shape[0]
        word = Shape(force.displacement_bits, force.signed)
        members = {
            "i": In(stream.Signature(data.ArrayLayout(word, 1))),
            "o": Out(stream.Signature(data.ArrayLayout(signed(force.width), self.axes))),
        }
        if wants_map:
            response = data.ArrayLayout(signed(force.pixel_width), 1)
            members["map"] = Out(stream.Signature(data.ArrayLayout(response, self.axes)))
        super().__init__(members)

    @staticmethod
    def latency_of(axes: int, size: int, kernel_size: int, fold: int) -> int:
        """`latency` for frames of `size` × `size` displacements, without building the component."""
        ahead = fold * PatchGenerator.reach_of(size, kernel_size, 1) + BORDER_CLOCKS
        return ahead + products_latency(axes, kernel_size**2, fold) + SharedAccumulator.latency

    map_latency_of = latency_of

    @staticmethod
    def multipliers_of(
        axes: int, kernel_size: int, fold: int, *, input_bits: int, kernel_bits: int, dsp: DspSlice
    ) -> int:
        """DSP slices: about axes · K²/fold products of `dsp.slices(…)` slices each, see `shares_of`."""
        return shared_multipliers(
            axes, kernel_size**2, fold, input_bits=input_bits, weight_bits=kernel_bits, dsp=dsp
        )

    @property
    def map_latency(self) -> int:
        """Clocks from a displacement to the same pixel's beat of the force map, if they come every `fold`
        clocks."""
        return self.map_latency_of(self.axes, self.size, self.force.size, self.fold)

    @property
    def latency(self) -> int:
        return self.latency_of(self.axes, self.size, self.force.size, self.fold)

    @property
    def interval(self) -> int:
        return self.fold * self.size**2

    @property
    def multipliers(self) -> int:
        force = self.force
        return self.multipliers_of(
            self.axes,
            force.size,
            self.fold,
            input_bits=force.displacement_bits + (not force.signed),
            kernel_bits=force.kernel_bits,
            dsp=self.dsp,
        )

    def elaborate(self, platform):
        m = Module()
        force, values = self.force, self.force.size**2
        m.submodules.generator = generator = PatchGenerator(
            self.size, force.size, force.displacement_bits, lanes=1, signed=force.signed, fold=self.fold
        )
        by_pixel = np.moveaxis(force.kernel, 0, 2).reshape(-1, self.axes, values)
        m.submodules.products = products = SharedProducts(
            by_pixel,
            [(k,) for k in range(values)],
            shape=Shape(force.displacement_bits, force.signed),
            limit=force.displacement_limit,
            fold=self.fold,
        )
        parts = generator.latency + products.latency + SharedAccumulator.latency
        assert parts == self.latency, f"latency {parts}: stated {self.latency}"
        wiring.connect(m, wiring.flipped(self.i), generator.i)
        m.d.comb += [
            products.i.payload.eq(generator.o.payload[0]),
            products.i.valid.eq(generator.o.valid),
            generator.o.ready.eq(products.i.ready),
        ]

        sums, done = self._sums(m, products, force.width, "ends_frame", "accumulator")
        m.d.comb += [self.o.payload[axis].eq(total) for axis, total in enumerate(sums)]
        served = [self._offer(m, products.advance, self.o, done, "force")]
        if self.wants_map:
            sums, done = self._sums(m, products, force.pixel_width, "ends_pixel", "response")
            m.d.comb += [self.map.payload[axis][0].eq(total) for axis, total in enumerate(sums)]
            served.append(self._offer(m, products.advance, self.map, done, "map"))
        m.d.comb += products.advance.eq(Cat(served).all())
        return m

    def _sums(
        self, m: Module, products: SharedProducts, width: int, ends: str, name: str
    ) -> tuple[list, Signal]:
        """The sum of each axis over what `ends` says, and whether they are complete."""
        sums, done = [], {}
        for share, bits, part in zip(products.shares, products.widths, products.parts, strict=True):
            accumulator = SharedAccumulator(share.axes, width=width, term_width=bits)
            m.submodules[f"{name}_{share.first}"] = accumulator
            m.d.comb += [
                accumulator.advance.eq(products.advance),
                accumulator.term.eq(part.sum),
                accumulator.valid.eq(part.valid),
                accumulator.ends.eq(part[ends]),
            ]
            sums += list(accumulator.sums)
            done[share.slots] = accumulator.done
        return sums, done[max(done)]

    def _offer(self, m: Module, advance, o, done, name: str):
        """Offer sums once, in the clocks until `advance`; returns whether they do not wait for `o`."""
        taken = Signal(name=f"{name}_taken")
        m.d.comb += o.valid.eq(done & ~taken)
        with m.If(advance):
            m.d.sync += taken.eq(0)
        with m.Elif(o.valid & o.ready):
            m.d.sync += taken.eq(1)
        return ~done | taken | o.ready
