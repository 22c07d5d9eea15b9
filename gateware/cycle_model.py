# amaranth: UnusedElaboratable=no
"""Clock cycles and multipliers of a scene's hardware from formulas, without a bundle or elaboration."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise

import numpy as np

from fastac.gateware.arithmetic.dsp_slice import DspSlice
from fastac.gateware.arithmetic.frame_sum import beats_per_frame
from fastac.gateware.arithmetic.packed_products import best_packing
from fastac.gateware.dot_force import VALUES
from fastac.gateware.dot_slip import DotSlip
from fastac.gateware.dots.darkness import DarknessStream
from fastac.gateware.dots.dot_stream import DotStream
from fastac.gateware.force.folded_patch import FoldedPatchForce
from fastac.gateware.force.folded_sum import FoldedWeightedSum, products_of
from fastac.gateware.force.force_interval import ForceIntervalStream
from fastac.gateware.force.weighted_sum import WeightedSumStream
from fastac.gateware.frame_cycles import FrameCycles
from fastac.gateware.fz_stream import PatchForceStream
from fastac.gateware.mlp_mvm import tile_multipliers
from fastac.gateware.network.background import BackgroundSubtraction
from fastac.gateware.network.feature_smoothing import FeatureSmoothing
from fastac.gateware.network.folded_network import FoldedMlp
from fastac.gateware.network.folded_ratio import FoldedDivider
from fastac.gateware.network.gradient_ratio import GradientDivider
from fastac.gateware.network.pixel_network import NormalMlp
from fastac.gateware.network.slope_bridge import SlopeBridgeStream
from fastac.gateware.poisson.depth import DepthOutput, Displacement
from fastac.gateware.poisson.solvers import SOLVERS
from fastac.gateware.poisson.stages import frame_interval
from fastac.gateware.slip.rigid_sums import RigidSums
from fastac.gateware.stream.frame_guard import FrameGuard
from fastac.gateware.stream.frame_validity import by_stage
from fastac.gateware.target.device import device_of
from fastac.models.integer.dot_follower import DotFollower
from fastac.models.integer.dot_spread import DotSpread
from fastac.models.integer.features import WIDTH, limits
from fastac.models.integer.force_interval import OF_PIXELS
from fastac.models.integer.frame_validity import REASONS
from fastac.models.integer.laplacian import STENCILS, boundary_term
from fastac.models.integer.solver_base import IntegerSolver
from fastac.models.integer.source import PoissonSource
from fastac.models.integer.words import Fixed, signed_width, to_words
from fastac.models.vision.expected_dots import bridge_reach, expected_follower
from fastac.scenes.schema import Scene
from fastac.sensor.geometry import rest_depth_mm

NORMAL, SLOPES, DISPLACEMENT = 3, 2, 1
"""Values per pixel: of a normal, and of the inputs of a weighted sum (two slopes or one displacement)."""


@dataclass(frozen=True)
class Figures:
    """Latency and interval in clocks, and multipliers, of a component that is not built."""

    latency: int = 0
    interval: int = 0
    multipliers: int = 0
    followed: int = 0
    map_latency: int = 0
    products: dict[str, int] = field(default_factory=dict)
    stages: dict[str, int] = field(default_factory=dict)


# Engines that are made only to be asked; asked again for every part that the same integers may be for.


@lru_cache
def _multipliers(engine: Callable, stage: object, lanes: int, fold: int, dsp: DspSlice) -> int:
    """Products of the engine of one of a solver's stages."""
    return engine(stage, lanes=lanes, fold=fold, dsp=dsp).multipliers


@lru_cache
def _dot_clocks(follower: DotFollower, lanes: int, fold: int) -> tuple[int, int]:
    """Latency and interval of a DotStream."""
    dots = DotStream(follower, lanes=lanes, fold=fold)
    return dots.latency, dots.interval


class CycleModel(FrameCycles):
    """Latencies, intervals and multipliers of the Datapath that a scene needs, without building it.

    hidden : neurons of the pixel network's hidden layers; None: those of the scene
    flat : the depth at rest is zero, so that no ROM adds it in mode "difference"; None: from the scene's
        geometry

    follower : of the scene's dots; None: where the virtual fingertip has them, so that the figures may differ
        from those of a real skin, or after another calibration, by the clocks between some rows of windows

    solver : with its words, whose lengths decide how many DSP48E1 a product takes; None: words as long as
        `numbers.data_bits` allows, so that there may be fewer multipliers than the figures say

    Nothing else depends on training: the figures are the same for all weights, biases and kernels.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        hidden: Sequence[int] | None = None,
        flat: bool | None = None,
        follower: DotFollower | None = None,
        solver: IntegerSolver | None = None,
    ):
        self.scene, self.lanes, self.fold = scene, scene.lanes, scene.fold
        self.dsp = device_of(scene).dsp
        if flat is None:
            flat = scene.sensor.geometry == "flat"
        if hidden is None:
            hidden = scene.network.hidden
        sizes = (len(scene.sensor.channel_names) + 2, *hidden, NORMAL)
        self.guard = FrameGuard
        levels = scene.sensor.level_light
        self.background = Figures(BackgroundSubtraction.latency_of(level_light=levels))
        self.smoothing = None
        if window_px := scene.network.smoothing_px:
            width = scene.sensor.width_px
            self.smoothing = Figures(FeatureSmoothing.latency_of(window_px, width, self.lanes, self.fold))
        self.mlp = self._network(sizes)
        if scene.wants_slopes:
            self.divider = Figures(self._divider_latency(scene.numbers.slope_bits))
        if scene.wants_bridge:
            self.bridge = Figures(
                SlopeBridgeStream.latency_of(bridge_reach(scene.sensor), self.lanes, self.fold)
            )
        if scene.wants_darkness:
            self.darkness = Figures(DarknessStream.latency_of(len(scene.sensor.channel_names)))
        if scene.wants_solver:
            self.solver = self._solver(solver)
            difference = scene.poisson.mode == "difference"
            self.depth_output = Figures(DepthOutput.latency_of(has_rom=difference and not flat))
            self.displacement = Figures(Displacement.latency_of(has_rom=not difference))
        if scene.wants_force:
            self.force_stream = self._weighted_sum() if self._sums_words else self._patch_force()
        if scene.wants_dots:
            loadable = scene.hardware.weights == "loadable"
            follower = follower or expected_follower(scene.sensor, loadable=loadable)
            self.dots = self._dots(follower)
        if scene.wants_slip:
            spread = DotSpread.of_follower(follower, 0)  # no figure depends on the threshold
            self.slip_stream = Figures(
                DotSlip.latency_of(spread), DotSlip.interval_of(spread), RigidSums.multipliers
            )
        self.wants_interval = scene.wants_interval
        if self.wants_interval:
            self.interval_stream = self._interval()

    def _divider_latency(self, bits: int) -> int:
        """Clocks of the division of slopes of so many bits."""
        if self.fold > 1:
            return FoldedDivider.latency_of(bits, self.fold)
        return GradientDivider.latency_of(bits)

    def _network(self, sizes: Sequence[int]) -> Figures:
        """Figures of the pixel network of so many features, hidden neurons of each layer, and 3."""
        if self.fold > 1:
            latency = FoldedMlp.latency_of(sizes[:-1], self.fold)
            return Figures(latency, multipliers=FoldedMlp.multipliers_of(sizes, self.fold))
        return Figures(NormalMlp.latency_of(sizes[:-1]), multipliers=self._network_multipliers(sizes))

    def _network_multipliers(self, sizes: Sequence[int]) -> int:
        """Multipliers of all lanes: those of the tiles, and one per hidden neuron for requantisation."""
        numbers = self.scene.numbers
        if self.scene.hardware.weights == "baked":
            return 0
        count, last = sum(sizes[1:-1]), len(sizes) - 2
        for k, (inputs, neurons) in enumerate(pairwise(sizes)):
            bits = numbers.last_weight_bits if k == last else numbers.weight_bits
            input_limit, width = limits(inputs - 2), WIDTH
            if k:
                input_limit = [(1 << numbers.activation_bits) - 1] * inputs
                width = numbers.activation_bits + 1
            packed = best_packing((1 << (bits - 1)) - 1, input_limit, width, self.dsp) is not None
            count += tile_multipliers(neurons, inputs, packed=packed)
        return self.lanes * count

    def _solver(self, solver: IntegerSolver | None) -> Figures:
        sensor, poisson, size = self.scene.sensor, self.scene.poisson, self.scene.inner_px
        kind = SOLVERS[poisson.solver]
        stages = kind.stages_of(sensor.width_px, self.lanes, poisson.divergence, fold=self.fold)
        interval = frame_interval(sensor.height_px, sensor.width_px, self.lanes, self.fold)
        if solver is None:
            multipliers = kind.multipliers_of(
                size,
                self.lanes,
                source_width=self._source_width,
                data_bits=self.scene.numbers.data_bits,
                coefficient_width=self.scene.numbers.coefficient_fraction_bits + 1,
                dsp=self.dsp,
                fold=self.fold,
            )
        else:
            multipliers = sum(
                _multipliers(kind.engines[type(stage)], stage, self.lanes, self.fold, self.dsp)
                for stage in solver.parts.values()
            )
        return Figures(interval=interval, multipliers=multipliers, stages=stages)

    @property
    def _source_width(self) -> int:
        """Bits of the source at most: with any slopes at rest, or with the depth at rest of the geometry."""
        numbers, sensor, poisson = self.scene.numbers, self.scene.sensor, self.scene.poisson
        fraction = numbers.gradient_fraction_bits + STENCILS[poisson.divergence].fraction_bits
        offset, limit = np.zeros((1, 1), int), 4 * ((1 << (numbers.slope_bits - 1)) - 1)
        if poisson.mode == "absolute":
            rest = boundary_term(rest_depth_mm(sensor) / sensor.pitch_mm)
            offset, limit = to_words(rest, Fixed(62, fraction)), None
        return PoissonSource(poisson.divergence, numbers.slope_bits, offset, limit).width

    @property
    def _sums_words(self) -> bool:
        return self.scene.force_from_slopes or self.scene.force.kernel == "collapsed"

    @property
    def _displacement_bits(self) -> int:
        """Bits of a displacement as a signed word."""
        return self.scene.numbers.displacement_bits + (not self.scene.force.signed)

    def _weighted_sum(self) -> Figures:
        """Figures of WeightedSumStream; a collapsed kernel's words can hold any sum of K² kernel words."""
        scene, kind = self.scene, WeightedSumStream
        rows, columns = scene.inner_px, scene.inner_px
        values, input_bits = DISPLACEMENT, self._displacement_bits
        weight_bits = signed_width(scene.force.kernel_size**2 << (scene.numbers.kernel_bits - 1))
        if scene.force_of_weights:
            weight_bits = scene.numbers.kernel_bits
            if self.fold > 1:
                values = products_of(len(scene.force.bends_mm))
        if scene.force_from_slopes:
            rows, columns = scene.sensor.height_px, scene.sensor.width_px
            values, input_bits = SLOPES, scene.numbers.slope_bits
            weight_bits = scene.numbers.slope_weight_bits
        axes, words = len(scene.force_axes), {"input_bits": input_bits, "weight_bits": weight_bits}
        beats = beats_per_frame(rows, columns, self.lanes)
        if self.fold > 1:
            folded = FoldedWeightedSum
            multipliers = folded.multipliers_of(axes, values, self.fold, **words, dsp=self.dsp)
            return Figures(folded.latency_of(axes, values, self.fold), beats * self.fold, multipliers)
        multipliers = kind.multipliers_of(axes, values, self.lanes, **words, dsp=self.dsp)
        return Figures(kind.latency_of(values, self.lanes), beats, multipliers)

    def _dots(self, follower: DotFollower) -> Figures:
        """Figures of DotForceStream."""
        kind, scene = WeightedSumStream, self.scene
        latency, interval = _dot_clocks(follower, self.lanes, self.fold)
        multipliers = kind.multipliers_of(
            len(scene.force_axes),
            VALUES,
            1,
            input_bits=follower.width,
            weight_bits=scene.numbers.dot_weight_bits,
            dsp=self.dsp,
        )
        interval = max(interval, len(follower.rest))
        return Figures(latency + kind.latency_of(VALUES, 1), interval, multipliers, latency)

    def _interval(self) -> Figures:
        """Figures of ForceIntervalStream, of all measures that an interval may depend on."""
        kind, axes = ForceIntervalStream, len(self.scene.force_axes)
        names = REASONS[: 1 + len(self.scene.sensor.channel_names)] + OF_PIXELS[-3:]
        products = {stage: len(measures) * axes for stage, measures in by_stage(names).items()}
        interval = kind.interval_of(sum(products.values()), axes)
        return Figures(kind.latency_of(axes), interval, kind.multipliers, products=products)

    def _patch_force(self) -> Figures:
        scene, size, kernel = self.scene, self.scene.inner_px, self.scene.force.kernel_size
        axes, beats = len(scene.force_axes), beats_per_frame(size, size, self.lanes)
        words = {"input_bits": self._displacement_bits, "kernel_bits": scene.numbers.kernel_bits}
        if self.fold > 1:
            kind = FoldedPatchForce
            latency = kind.latency_of(axes, size, kernel, self.fold)
            multipliers = kind.multipliers_of(axes, kernel, self.fold, **words, dsp=self.dsp)
            return Figures(latency, beats * self.fold, multipliers, map_latency=latency)
        kind = PatchForceStream
        multipliers = kind.multipliers_of(axes, kernel, self.lanes, **words, dsp=self.dsp)
        latency = kind.latency_of(size, kernel, self.lanes)
        map_latency = kind.map_latency_of(size, kernel, self.lanes)
        return Figures(latency, beats, multipliers, map_latency=map_latency)


def cycles(
    scene: Scene,
    *,
    hidden: Sequence[int] | None = None,
    flat: bool | None = None,
    follower: DotFollower | None = None,
) -> dict:
    """Clock cycles of the scene's hardware without back-pressure, as the report's `latency_cycles`.

    `stage`: shares of normals, depth and force; `part`: those of each stage, and `force_part` those on the
    way to a force that does not wait for the depth; `force_to_half_widths`, at most, for its interval may
    depend on fewer measures; `first_pixel_to_…` for each output of the scene, and to
    the last beat of its packet; `last_pixel_to_force`; `initiation_interval`.
    Parameters as for `CycleModel`.
    """
    model = CycleModel(scene, hidden=hidden, flat=flat, follower=follower)
    found = {"stage": model.modules, "part": model.stages, "initiation_interval": model.interval}
    if scene.force_beside_depth:
        found["force_part"] = model.force_stages
    if scene.wants_force:
        found["first_pixel_to_force"] = model.first_pixel_to_force
        found["last_pixel_to_force"] = model.last_pixel_to_force
    if model.wants_interval:
        found["force_to_half_widths"] = model.force_to_half_widths
    for name in ("depth", "normals"):
        if name in scene.outputs:
            found[f"first_pixel_to_{name}"] = getattr(model, f"first_pixel_to_{name}")
    return found | {f"first_pixel_to_{k}_packet": v for k, v in model.first_pixel_to_packet.items()}


def multipliers(
    scene: Scene, *, hidden: Sequence[int] | None = None, solver: IntegerSolver | None = None
) -> dict[str, int]:
    """Number of DSP slices of the scene's hardware by module, equal to `Datapath.multipliers`.

    Parameters as for `CycleModel`.
    """
    return CycleModel(scene, hidden=hidden, solver=solver).multipliers
