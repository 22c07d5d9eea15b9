"""From displacement rows to the raw force accumulators A of a frame: patches times kernels, summed."""

import numpy as np
from amaranth import Module, Shape, Signal, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.frame_sum import (
    FrameAccumulator,
    adder_tree,
    beats_per_frame,
    dsp_slices,
    tree_levels,
)
from fastac.gateware.arithmetic.product import LATENCY as PRODUCT_LATENCY
from fastac.gateware.arithmetic.product import product
from fastac.gateware.force.patch_generator import PatchGenerator, check_patch_size
from fastac.gateware.stream.fork import Fork
from fastac.gateware.stream.handshake import pipeline_handshake
from fastac.gateware.stream.tables import RasterRom, raster_beats
from fastac.models.integer.force import PatchForce
from fastac.models.integer.words import signed_width


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
    i : stream of `lanes` patches of K·K displacements, Shape(force.displacement_bits, force.signed)
    o : stream of axes × `lanes` responses, signed(force.pixel_width); 0 in void lanes

    `latency` = 5 + ceil(log2(K²)) clocks (ROM 2, product 3, adder tree) pass from a patch to its response.
    One multiplier per axis, lane and kernel word, with the registers of a DSP slice around it.
    """

    def __init__(self, force: PatchForce, *, lanes: int):
        self.force, self.lanes = force, lanes
        self.axes, self.words = len(force.kernel), force.size**2
        patch = data.ArrayLayout(Shape(force.displacement_bits, force.signed), self.words)
        responses = data.ArrayLayout(signed(force.pixel_width), lanes)
        super().__init__(
            {
                "i": In(stream.Signature(data.ArrayLayout(patch, lanes))),
                "o": Out(stream.Signature(data.ArrayLayout(responses, self.axes))),
            }
        )

    @property
    def latency(self) -> int:
        return KernelRom.latency + PRODUCT_LATENCY + tree_levels(self.words)

    def elaborate(self, platform):
        m = Module()
        advance = pipeline_handshake(m, self.i, self.o, self.latency)

        m.submodules.kernels = kernels = KernelRom(self.force, lanes=self.lanes)
        m.d.comb += [kernels.advance.eq(advance), kernels.take.eq(self.i.valid)]
        patches = self.i.payload
        for stage in range(KernelRom.latency):
            delayed = Signal(patches.shape(), reset_less=True, name=f"patches_{stage}")
            with m.If(advance):
                m.d.sync += delayed.eq(patches)
            patches = delayed

        bounds = np.abs(kernels.table) * self.force.displacement_limit
        for axis in range(self.axes):
            for lane in range(self.lanes):
                name, products = f"f_{axis}_{lane}", []
                for k, bound in enumerate(bounds[:, axis, lane].max(axis=0)):
                    a, b = patches[lane][k], kernels.word[axis][lane][k]
                    whole = product(m, platform, advance, a, b, name=f"{name}_product_{k}")
                    products.append(whole[: signed_width(int(bound))].as_signed())
                response = adder_tree(m, advance, products, bounds[:, axis, lane], name)
                m.d.comb += self.o.payload[axis][lane].eq(response)
        return m


class PatchForceStream(wiring.Component):
    """Whole frames of displacement to the accumulators A = Σ_p f(p), bit for bit `force(q)`.

    Members
    -------
    i : stream of `lanes` displacements, Shape(force.displacement_bits, force.signed); N rows of
        B = ceil(N/lanes) beats make a frame, lanes beyond N are void. A signed one is never the lowest word.
    o : stream of one beat a frame, an accumulator signed(force.width) per axis
    map : stream of axes × `lanes` responses f(p), signed(force.pixel_width), bit for bit
        `force.force_map(q)`; N rows of B beats in raster order, 0 in void lanes. Only if `wants_map`.

    From the last beat of a frame to its force pass, if nothing stalls, `latency` =
    (K//2)·B + ceil((K//2)/lanes) + 9 + ceil(log2(lanes·K²)) clocks: reach of the patches, 3 of their
    generator, 5 and a tree for the responses, a tree over the lanes and the accumulator. The map's last beat
    stands `map_latency` clocks after the frame's. A new frame may begin every `interval` = N·B clocks; the
    rules of `PatchGenerator` hold for the rest of the previous one. Until a force, or a beat of the map, is
    taken everything behind it waits.
    """

    def __init__(self, force: PatchForce, *, lanes: int, wants_map: bool = False):
        shape = force.kernel.shape
        if len(shape) != 5 or shape[1] != shape[2] or shape[3] != shape[4]:
            raise ValueError(f"kernel {shape}: expected (axes, N, N, K, K)")
        check_patch_size(shape[1], force.size, force.displacement_bits, lanes)
        self.force, self.lanes, self.size, self.wants_map = force, lanes, shape[1], wants_map
        words = data.ArrayLayout(Shape(force.displacement_bits, force.signed), lanes)
        members = {
            "i": In(stream.Signature(words)),
            "o": Out(stream.Signature(data.ArrayLayout(signed(force.width), shape[0]))),
        }
        if wants_map:
            responses = data.ArrayLayout(signed(force.pixel_width), lanes)
            members["map"] = Out(stream.Signature(data.ArrayLayout(responses, shape[0])))
        super().__init__(members)

    @property
    def row_beats(self) -> int:
        return -(-self.size // self.lanes)

    @staticmethod
    def map_latency_of(size: int, kernel_size: int, lanes: int) -> int:
        """`map_latency` for frames of `size` × `size` displacements."""
        half = kernel_size // 2
        return half * -(-size // lanes) - (-half // lanes) + 8 + tree_levels(kernel_size**2)

    @classmethod
    def latency_of(cls, size: int, kernel_size: int, lanes: int) -> int:
        return cls.map_latency_of(size, kernel_size, lanes) + tree_levels(lanes) + 1

    @staticmethod
    def multipliers_of(axes: int, kernel_size: int, lanes: int, *, input_bits: int, kernel_bits: int) -> int:
        """DSP48E2: axes · lanes · K², times `dsp_slices` of a displacement and a kernel word, both signed."""
        return axes * lanes * kernel_size**2 * dsp_slices(input_bits, kernel_bits)

    @property
    def map_latency(self) -> int:
        """Clocks from a beat of displacements to the beat of the same pixels' responses."""
        return self.map_latency_of(self.size, self.force.size, self.lanes)

    @property
    def latency(self) -> int:
        return self.latency_of(self.size, self.force.size, self.lanes)

    @property
    def interval(self) -> int:
        return beats_per_frame(self.size, self.size, self.lanes)

    @property
    def multipliers(self) -> int:
        force = self.force
        return self.multipliers_of(
            len(force.kernel),
            force.size,
            self.lanes,
            input_bits=force.displacement_bits + (not force.signed),
            kernel_bits=force.kernel_bits,
        )

    def elaborate(self, platform):
        m = Module()
        force = self.force
        m.submodules.generator = generator = PatchGenerator(
            self.size, force.size, force.displacement_bits, lanes=self.lanes, signed=force.signed
        )
        m.submodules.response = response = PixelResponse(force, lanes=self.lanes)
        bounds = np.abs(kernel_words(force, self.lanes)).sum(axis=-1) * force.displacement_limit
        constant = np.zeros(len(force.kernel), np.int64)
        m.submodules.accumulator = accumulator = FrameAccumulator(bounds, constant)
        parts = generator.latency + response.latency + accumulator.latency
        assert parts == self.latency, f"latency {parts}: stated {self.latency}"
        assert generator.interval == accumulator.interval == self.interval
        wiring.connect(m, wiring.flipped(self.i), generator.i)
        wiring.connect(m, generator.o, response.i)
        if self.wants_map:
            m.submodules.map_fork = fork = Fork(response.o.payload.shape(), 2)
            wiring.connect(m, response.o, fork.i)
            wiring.connect(m, fork.o[0], accumulator.i)
            wiring.connect(m, fork.o[1], wiring.flipped(self.map))
        else:
            wiring.connect(m, response.o, accumulator.i)
        wiring.connect(m, accumulator.o, wiring.flipped(self.o))
        return m
