"""From displacement rows to the raw force accumulators A of a frame: patches times kernels, summed."""

import numpy as np
from amaranth import Cat, Module, Mux, Signal, signed, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from models.fixed import signed_width
from models.integer import PatchForce

from .displacement import RasterRom, raster_beats
from .patch_generator import PatchGenerator, check_patches


def tree_levels(terms: int) -> int:
    """Registers that a value passes in `sum_tree`: ceil(log2(terms))."""
    return (terms - 1).bit_length()


def sum_tree(m: Module, advance, terms: list, bounds: np.ndarray, name: str):
    """Add a registered tree of two-operand adders over `terms` to `m`; returns the sum.

    `bounds` (cases, terms) holds the largest magnitude of each term in each case that can occur (here: with
    each word of the kernel ROM). A node is as wide as the largest, over the cases, of its terms' sums.
    """
    for level in range(tree_levels(len(terms))):
        pairs = [terms[k : k + 2] for k in range(0, len(terms), 2)]
        bounds = np.add.reduceat(bounds, np.arange(0, len(terms), 2), axis=1)
        terms = [
            Signal(signed(signed_width(int(bound))), reset_less=True, name=f"{name}_sum{level}_{k}")
            for k, bound in enumerate(bounds.max(axis=0))
        ]
        with m.If(advance):
            m.d.sync += [s.eq(sum(pair[1:], pair[0])) for s, pair in zip(terms, pairs, strict=True)]
    return terms[0]


def kernel_words(force: PatchForce, lanes: int) -> np.ndarray:
    """The kernels in the order of the beats: (N · ceil(N/lanes), axes, lanes, K²); void lanes are zero."""
    axes, n, _, k, _ = force.kernel.shape
    by_pixel = force.kernel.transpose(1, 2, 0, 3, 4).reshape(n, n, axes, k * k)
    return raster_beats(by_pixel, lanes).swapaxes(1, 2)


class KernelRom(RasterRom):
    """The kernels of `force`, one word a beat: axes × lanes × K² words of signed(force.kernel_bits).

    Members, order and latency are those of `RasterRom`.
    """

    def __init__(self, force: PatchForce, *, lanes: int):
        super().__init__(kernel_words(force, lanes), force.kernel_bits)


class PixelResponse(wiring.Component):
    """The response of each pixel: f(p) = Σ_m k(p, m) · v(p, m), the force map before it is summed.

    Members
    -------
    i : stream of `lanes` patches of K·K unsigned(force.displacement_bits), as `PatchGenerator` gives them
    o : stream of axes × `lanes` responses, signed(force.pixel_width); 0 in void lanes

    `latency` = 3 + ceil(log2(K²)) clocks (ROM 2, product, adder tree) pass from a patch to its response.
    One multiplier per axis, lane and kernel word, with the registers of a DSP slice around it.
    """

    def __init__(self, force: PatchForce, *, lanes: int):
        self.force, self.lanes = force, lanes
        self.axes, self.words = len(force.kernel), force.size**2
        patch = data.ArrayLayout(unsigned(force.displacement_bits), self.words)
        responses = data.ArrayLayout(signed(force.pixel_width), lanes)
        super().__init__(
            {
                "i": In(stream.Signature(data.ArrayLayout(patch, lanes))),
                "o": Out(stream.Signature(data.ArrayLayout(responses, self.axes))),
            }
        )

    @property
    def latency(self) -> int:
        return KernelRom.latency + 1 + tree_levels(self.words)

    def elaborate(self, platform):
        m = Module()
        advance = Signal()
        valid = Signal(self.latency)
        m.d.comb += [
            advance.eq(self.o.ready | ~self.o.valid),
            self.i.ready.eq(advance),
            self.o.valid.eq(valid[-1]),
        ]
        with m.If(advance):
            m.d.sync += valid.eq(Cat(self.i.valid, valid))

        m.submodules.kernels = kernels = KernelRom(self.force, lanes=self.lanes)
        m.d.comb += [kernels.advance.eq(advance), kernels.take.eq(self.i.valid)]
        patches = self.i.payload
        for stage in range(KernelRom.latency):
            delayed = Signal(patches.shape(), reset_less=True, name=f"patches_{stage}")
            with m.If(advance):
                m.d.sync += delayed.eq(patches)
            patches = delayed

        bounds = np.abs(kernels.table) * ((1 << self.force.displacement_bits) - 1)
        for axis in range(self.axes):
            for lane in range(self.lanes):
                name, products = f"f_{axis}_{lane}", []
                for k, bound in enumerate(bounds[:, axis, lane].max(axis=0)):
                    shape = signed(signed_width(int(bound)))
                    product = Signal(shape, reset_less=True, name=f"{name}_product_{k}")
                    with m.If(advance):
                        m.d.sync += product.eq(kernels.word[axis][lane][k] * patches[lane][k])
                    products.append(product)
                response = sum_tree(m, advance, products, bounds[:, axis, lane], name)
                m.d.comb += self.o.payload[axis][lane].eq(response)
        return m


class PatchForceStream(wiring.Component):
    """Whole frames of displacement to the accumulators A = Σ_p f(p), bit for bit `force(q)`.

    Members
    -------
    i : stream of `lanes` displacements, unsigned(force.displacement_bits); N rows of B = ceil(N/lanes) beats
        make a frame, lanes beyond N are void
    o : stream of one beat a frame, an accumulator signed(force.width) per axis

    From the last beat of a frame to its force pass, if nothing stalls, `latency` =
    (K//2)·B + ceil((K//2)/lanes) + 7 + ceil(log2(lanes·K²)) clocks: reach of the patches, 3 of their
    generator, 3 and a tree for the responses, a tree over the lanes and the accumulator. A new frame may
    begin every `interval` = N·B clocks; the rules of `PatchGenerator` hold for the rest of the previous
    one. Until a force is taken everything behind it waits.
    """

    def __init__(self, force: PatchForce, *, lanes: int):
        shape = force.kernel.shape
        if len(shape) != 5 or shape[1] != shape[2] or shape[3] != shape[4]:
            raise ValueError(f"kernel {shape}: expected (axes, N, N, K, K)")
        check_patches(shape[1], force.size, force.displacement_bits, lanes)
        self.force, self.lanes, self.size = force, lanes, shape[1]
        words = data.ArrayLayout(unsigned(force.displacement_bits), lanes)
        super().__init__(
            {
                "i": In(stream.Signature(words)),
                "o": Out(stream.Signature(data.ArrayLayout(signed(force.width), shape[0]))),
            }
        )

    @property
    def row_beats(self) -> int:
        return -(-self.size // self.lanes)

    @property
    def latency(self) -> int:
        half, lanes = self.force.size // 2, self.lanes
        reach = half * self.row_beats - (-half // lanes)
        return reach + 7 + tree_levels(lanes * self.force.size**2)

    @property
    def interval(self) -> int:
        return self.size * self.row_beats

    def elaborate(self, platform):
        m = Module()
        m.submodules.generator = generator = PatchGenerator(
            self.size, self.force.size, self.force.displacement_bits, lanes=self.lanes
        )
        m.submodules.response = response = PixelResponse(self.force, lanes=self.lanes)
        parts = generator.latency + response.latency + tree_levels(self.lanes) + 1
        assert parts == self.latency, f"latency {parts}: stated {self.latency}"
        assert generator.interval == self.interval
        wiring.connect(m, wiring.flipped(self.i), generator.i)
        wiring.connect(m, generator.o, response.i)
        responses = response.o

        # The last register is the accumulator: while a finished force stands in it, all before it waits.
        advance, done = Signal(), Signal()
        valid = Signal(tree_levels(self.lanes))
        summed = Cat(responses.valid, valid)[-1]  # the lanes' sums stand before the accumulator
        m.d.comb += [
            advance.eq(self.o.ready | ~done),
            responses.ready.eq(advance),
            self.o.valid.eq(done),
        ]

        beat = Signal(range(self.interval))
        fresh = Signal(init=1)  # the next responses are the first of a frame
        last = beat == self.interval - 1
        with m.If(advance):
            m.d.sync += [valid.eq(Cat(responses.valid, valid)), done.eq(summed & last)]
            with m.If(summed):
                m.d.sync += [beat.eq(Mux(last, 0, beat + 1)), fresh.eq(last)]

        magnitudes = np.abs(kernel_words(self.force, self.lanes)).sum(axis=-1)
        bounds = magnitudes * ((1 << self.force.displacement_bits) - 1)
        for axis, lanes in enumerate(responses.payload):
            total = sum_tree(m, advance, list(lanes), bounds[:, axis], f"axis_{axis}")
            accumulator = Signal(signed(self.force.width), reset_less=True, name=f"accumulator_{axis}")
            with m.If(advance & summed):
                m.d.sync += accumulator.eq(Mux(fresh, 0, accumulator) + total)
            m.d.comb += self.o.payload[axis].eq(accumulator)
        return m
