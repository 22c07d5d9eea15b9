"""The force of all axes, F_x, F_y and F_z, despite the file's name: patches times kernels, summed per frame.

Each pixel's K×K displacement patch is multiplied with the pixel's own kernel, one kernel per force axis; the
sums over the frame are the raw force accumulators A, one per axis.
"""

import numpy as np
from amaranth import Const, Module, Shape, Signal, signed
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out

from fastac.gateware.arithmetic.dsp_slice import DSP48E2, DspSlice
from fastac.gateware.arithmetic.frame_sum import (
    FrameAccumulator,
    adder_tree,
    beats_per_frame,
    tree_levels,
)
from fastac.gateware.arithmetic.product import LATENCY as PRODUCT_LATENCY
from fastac.gateware.arithmetic.product import product
from fastac.gateware.force.patch_generator import PatchGenerator, check_patch_size
from fastac.gateware.stream.fork import Fork
from fastac.gateware.stream.handshake import credit_handshake
from fastac.gateware.stream.read_ahead_rom import ReadAheadRom
from fastac.gateware.stream.tables import raster_beats
from fastac.models.integer.force import PatchForce
from fastac.models.integer.words import signed_width


def kernel_words(force: PatchForce, lanes: int) -> np.ndarray:
    """The kernels in beat order: (N · ceil(N/lanes), axes, lanes, K²); unused lanes at a row's end are 0."""
    axes, n, _, k, _ = force.kernel.shape
    by_pixel = force.kernel.transpose(1, 2, 0, 3, 4).reshape(n, n, axes, k * k)
    return raster_beats(by_pixel, lanes).swapaxes(1, 2)


class KernelRom(ReadAheadRom):
    """ROM of the kernels, one word per beat: axes × lanes × K² values of signed(force.kernel_bits).

    Members, order and latency are those of `ReadAheadRom`.
    """

    def __init__(self, force: PatchForce, *, lanes: int):
        super().__init__(kernel_words(force, lanes), force.kernel_bits)


class PixelResponse(wiring.Component):
    """Multiply each pixel's patch with its kernels: f(p) = Σ_m k(p, m) · v(p, m), the force map.

    Members
    -------
    i : stream of `lanes` patches of K·K displacements, Shape(force.displacement_bits, force.signed)
    o : stream of axes × `lanes` responses f(p), signed(force.pixel_width); 0 in the unused lanes of a row's
        last beat

    `latency` = 5 + ceil(log2(K²)) clocks from a patch to its response, without back-pressure: 2 for the ROM,
    3 for the product, and the adder tree. Initiation interval: 1 clock per beat. There is one multiplier per
    axis, lane and kernel word, with the registers of a DSP slice around it. No register has a clock enable:
    beats that `o` does not take collect in a queue (`credit_handshake`). `i.ready` is low in the first
    `start` clocks after a reset, in which the first kernels are read.
    """

    start = KernelRom.start

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
        m.submodules.kernels = kernels = KernelRom(self.force, lanes=self.lanes)
        last, ago = credit_handshake(m, self.i, self.o, self.latency, start=kernels.ready)
        m.d.comb += kernels.take.eq(ago[0])
        patches = self.i.payload
        for stage in range(KernelRom.latency):
            delayed = Signal(patches.shape(), reset_less=True, name=f"patches_{stage}")
            m.d.sync += delayed.eq(patches)
            patches = delayed

        bounds = np.abs(kernels.table) * self.force.displacement_limit
        for axis in range(self.axes):
            for lane in range(self.lanes):
                name, products = f"f_{axis}_{lane}", []
                for k, bound in enumerate(bounds[:, axis, lane].max(axis=0)):
                    a, b = patches[lane][k], kernels.word[axis][lane][k]
                    whole = product(m, platform, Const(1), a, b, name=f"{name}_product_{k}")
                    products.append(whole[: signed_width(int(bound))].as_signed())
                response = adder_tree(m, Const(1), products, bounds[:, axis, lane], name)
                m.d.comb += last.payload[axis][lane].eq(response)
        return m


class PatchForceStream(wiring.Component):
    """Sum the responses of a whole displacement frame, A = Σ_p f(p), bit-exact to `force(q)`.

    Members
    -------
    i : stream of `lanes` displacements, Shape(force.displacement_bits, force.signed). A frame is N rows of
        B = ceil(N/lanes) beats; the lanes beyond N are ignored. A signed displacement must not be the most
        negative word.
    o : stream of one beat per frame: one accumulator per axis, signed(force.width)
    map : stream of axes × `lanes` responses f(p), signed(force.pixel_width), bit-exact to
        `force.force_map(q)`; N rows of B beats in raster order, 0 in unused lanes. Only if `wants_map`.

    `latency` = (K//2)·B + ceil((K//2)/lanes) + 9 + ceil(log2(lanes·K²)) clocks from a frame's last input beat
    to its force, without back-pressure: the patches' look-ahead, 3 for the patch generator, 5 and an adder
    tree for the responses, an adder tree over the lanes and 1 for the accumulator. The map's last beat comes
    `map_latency` clocks after the last input beat. Initiation interval: `interval` = N·B clocks per frame;
    what `PatchGenerator` says about the end of the previous frame applies here too. A force or map beat that
    is not taken stalls the whole pipeline before it.
    """

    def __init__(self, force: PatchForce, *, lanes: int, wants_map: bool = False, dsp: DspSlice = DSP48E2):
        shape = force.kernel.shape
        if len(shape) != 5 or shape[1] != shape[2] or shape[3] != shape[4]:
            raise ValueError(f"kernel {shape}: expected (axes, N, N, K, K)")
        check_patch_size(shape[1], force.size, force.displacement_bits, lanes)
        self.force, self.lanes, self.size, self.wants_map = force, lanes, shape[1], wants_map
        self.dsp = dsp
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
        """`map_latency` for frames of `size` × `size` displacements, without building the component."""
        half = kernel_size // 2
        return half * -(-size // lanes) - (-half // lanes) + 8 + tree_levels(kernel_size**2)

    @classmethod
    def latency_of(cls, size: int, kernel_size: int, lanes: int) -> int:
        return cls.map_latency_of(size, kernel_size, lanes) + tree_levels(lanes) + 1

    @staticmethod
    def multipliers_of(
        axes: int, kernel_size: int, lanes: int, *, input_bits: int, kernel_bits: int, dsp: DspSlice
    ) -> int:
        """DSP slices: axes · lanes · K² products of `dsp.slices(input_bits, kernel_bits)` slices each."""
        return axes * lanes * kernel_size**2 * dsp.slices(input_bits, kernel_bits)

    @property
    def map_latency(self) -> int:
        """Clocks from a beat of displacements to the same pixels' beat of the force map."""
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
            dsp=self.dsp,
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
