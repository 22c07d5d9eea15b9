# amaranth: UnusedElaboratable=no
"""The datapath from pixels to normals, depth and force, with just the stages that a scene needs."""

from dataclasses import replace

import numpy as np
from amaranth import Cat, Module, signed, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out, connect

from fastac.gateware.dots.dark_queue import DarkQueue
from fastac.gateware.dots.darkness import DarknessStream
from fastac.gateware.dots.dot_stream import DotStream
from fastac.gateware.force.force_sum import ForceSum
from fastac.gateware.force.weighted_sum import WeightedSumStream
from fastac.gateware.frame_cycles import FrameCycles
from fastac.gateware.fz_stream import PatchForceStream
from fastac.gateware.network.background import BackgroundSubtraction
from fastac.gateware.network.gradient_ratio import GradientDivider
from fastac.gateware.network.pixel_network import NormalMlp
from fastac.gateware.network.slope_bridge import SlopeBridgeStream
from fastac.gateware.poisson.depth import DepthOutput, Displacement
from fastac.gateware.poisson.solvers import SOLVERS
from fastac.gateware.stream.fork import Fork
from fastac.gateware.stream.frame_guard import EVENTS, FRAME_FAULTS, TIMEOUT_BITS, FrameGuard
from fastac.gateware.stream.frame_validity import DOTS_LATENCY, FrameValidity
from fastac.gateware.stream.queues import SkidBuffer
from fastac.gateware.stream.tables import TableFormat
from fastac.models.integer.features import WIDTH, coordinate_codes
from fastac.models.integer.force import PatchForce, WeightedSum
from fastac.models.integer.pipeline import IntegerPipeline


def last_row_first(stage):
    """`stage` (Depth, PatchForce or WeightedSum) with the rows of its tables reversed.

    For solvers that output the last row first; the rows within each patch's kernel are reversed as well.
    """
    if isinstance(stage, PatchForce):
        return replace(stage, kernel=stage.kernel[:, ::-1, :, ::-1])
    if isinstance(stage, WeightedSum):
        return replace(stage, weight=stage.weight[:, ::-1])
    return replace(stage, rest=stage.rest[::-1])


class Datapath(FrameCycles, wiring.Component):
    """A bundle's integer pipeline as hardware, bit-exact to `IntegerPipeline.run`.

    Only what `pipeline.scene` needs is built: no slopes without depth and force, no solver for the adjoint,
    no transposer for the tridiagonal solver, no patches for the collapsed kernel, no dots unless the
    force is of them too.

    Members
    -------
    axis, enable, timeout, FrameGuard's events and faults : see FrameGuard
    tag : stream of one bit per frame: the frame is bad; offered before the frame's depth
    capture, captured : see BackgroundSubtraction
    normals : stream of `lanes` normals (x, y, z), the network's outputs, signed(accumulator_width of the last
        layer) each. Only if the scene has this output.
    depth : stream of `lanes` depths, signed(pipeline.depth.width); N rows of ceil(N/lanes) beats, the last
        row first if `rows_reversed`. Only if the scene has this output.
    force : stream of one beat per frame: an accumulator per axis, signed(pipeline.force_width). Only if the
        scene has a force.
    force_map : stream of axes × `lanes` responses, signed(pipeline.force.pixel_width), in the depth's order.
        Only if the scene has this output.
    gradient_saturated, displacement_saturated : high while a beat with a clipped value is valid
    suspect_valid, suspect : see FrameValidity; a frame's pulse comes before its depth
    verdict : stream of a frame's flags, see FrameValidity; offered before the frame's last result
    hold : see FrameGuard. Like the following members only if the network is loadable.
    network : the network's parameters, see NormalMlp
    offset : write port of the source's offsets. Only in mode "difference" with a solver.
    rest : write port of the depth at rest. Only in mode "absolute" with a force.
    constant : the adjoint's constant, one accumulator per axis. Only for the adjoint.
    limits : limits of the flags, see FrameValidity
    threshold : write port of the thresholds of darkness. Only with dots or bridged slopes.

    The loadable members must not change while a frame is in flight. FrameCycles has latencies and intervals.
    """

    def __init__(self, pipeline: IntegerPipeline):
        scene = pipeline.scene
        sensor, lanes = scene.sensor, scene.hardware.pixels_per_clock
        height, width, channels = sensor.height_px, sensor.width_px, len(sensor.channel_names)
        self.pipeline, self.scene, self.lanes = pipeline, scene, lanes
        self.guard = FrameGuard(height, width, channels, lanes=lanes)
        self.background = BackgroundSubtraction(
            height,
            width,
            channels,
            coordinate_codes(width),
            coordinate_codes(height),
            pipeline.background,
            lanes=lanes,
        )
        self.mlp = NormalMlp(pipeline.layers, input_width=WIDTH, lanes=lanes)
        normal_width = pipeline.layers[-1].accumulator_width
        self.loadable = pipeline.layers[0].loadable
        self.validity = FrameValidity(pipeline.validity, lanes=lanes, loadable=self.loadable)
        members = {
            "axis": In(self.guard.axis.signature.flip()),
            "enable": In(1, init=1),
            "timeout": In(TIMEOUT_BITS),
            "tag": Out(stream.Signature(1)),
            "capture": In(1),
            "captured": Out(1),
            "gradient_saturated": Out(1),
            "displacement_saturated": Out(1),
            "suspect_valid": Out(1),
            "suspect": Out(1),
            "verdict": Out(self.validity.verdict.signature),
            **{name: Out(1) for name in (*EVENTS, *FRAME_FAULTS)},
        }
        self.normal_layout = data.ArrayLayout(data.ArrayLayout(signed(normal_width), 3), lanes)
        self.wants_normals = "normals" in scene.outputs
        self.wants_depth = "depth" in scene.outputs
        self.wants_force, self.wants_force_map = scene.wants_force, scene.wants_force_map
        self.wants_displacement = scene.wants_force and scene.wants_solver
        self.rows_reversed = scene.wants_solver and SOLVERS[scene.poisson.solver].last_row_first
        in_order = last_row_first if self.rows_reversed else lambda stage: stage
        if self.wants_normals:
            members["normals"] = Out(stream.Signature(self.normal_layout))
        if scene.wants_slopes:
            self.divider = GradientDivider(pipeline.ratio, lanes=lanes)
        if scene.wants_bridge:
            self.bridge = SlopeBridgeStream(pipeline.bridge, slope_bits=pipeline.ratio.width, lanes=lanes)
        if scene.wants_darkness:
            windows = (pipeline.bridge if scene.wants_bridge else pipeline.follower).windows
            self.darkness = DarknessStream(windows, lanes=lanes)
        if scene.wants_solver:
            self.solver = SOLVERS[scene.poisson.solver](
                pipeline.source,
                *pipeline.solver.parts.values(),
                height=height,
                width=width,
                lanes=lanes,
                loadable=self.loadable and scene.poisson.mode == "difference",
            )
        if self.wants_depth:
            self.depth_output = DepthOutput(in_order(pipeline.depth), lanes=lanes)
            members["depth"] = Out(self.depth_output.o.signature)
        if self.wants_displacement:
            self.displacement = Displacement(
                in_order(pipeline.depth), pipeline.quantiser, lanes=lanes, loadable=self.loadable
            )
        if self.wants_force:
            if isinstance(pipeline.force, PatchForce):
                self.force_stream = PatchForceStream(
                    in_order(pipeline.force), lanes=lanes, wants_map=self.wants_force_map
                )
            else:
                self.force_stream = WeightedSumStream(
                    in_order(pipeline.force),
                    lanes=lanes,
                    loadable=self.loadable and scene.force_from_slopes,
                    band=pipeline.band,
                )
            members["force"] = Out(self.force_stream.o.signature)
        if scene.wants_dots:
            self.dots = DotStream(pipeline.follower, lanes=lanes)
            self.dot_force_stream = WeightedSumStream(pipeline.dot_force.weighted, lanes=1)
            self.force_sum = ForceSum(
                pipeline.dot_force, skin_width=pipeline.force.width, width=pipeline.force_width
            )
            members["force"] = Out(self.force_sum.o.signature)
            if self.dot_force_stream.latency + self.force_sum.latency < DOTS_LATENCY:
                raise ValueError(f"flags of dots take {DOTS_LATENCY} clocks: later than the frame's result")
        if self.validity.latency > (self.force_stream if self.wants_force else self.mlp).latency:
            raise ValueError(
                f"validity flags take {self.validity.latency} clocks: later than the frame's result"
            )
        if self.wants_force_map:
            members["force_map"] = Out(self.force_stream.map.signature)
        if self.loadable:
            members["hold"] = In(1)
            members |= {name: In(unsigned(bits)) for name, (bits, _) in self.loadable_registers.items()}
            members |= {name: In(table.signature) for name, (table, _) in self.loadable_tables.items()}
        super().__init__(members)

    @property
    def loadable_registers(self) -> dict[str, tuple[int, int]]:
        """{name: (bits, value for this pipeline)} of the registers that a calibration sets."""
        if not self.loadable:
            return {}
        registers = {"network": (self.mlp.parameter_bits, self.mlp.parameter_image(self.pipeline.layers))}
        if self.pipeline.scene.force_from_slopes:
            force, mask = self.pipeline.force, (1 << self.pipeline.force.width) - 1
            words = [(int(c) & mask) << (k * force.width) for k, c in enumerate(force.constant)]
            registers["constant"] = (len(words) * force.width, sum(words))
        registers["limits"] = (
            self.validity.limits_bits,
            self.validity.limits_image(self.pipeline.validity),
        )
        return registers

    @property
    def loadable_tables(self) -> dict[str, tuple[TableFormat, np.ndarray]]:
        """{name: (format, values (depth, fields) for this pipeline)} of tables that a calibration sets."""
        tables, scene = {}, self.pipeline.scene
        if self.loadable and scene.wants_solver and scene.poisson.mode == "difference":
            tables["offset"] = self.solver.source.table, self.solver.source.table_values
        if self.loadable and scene.wants_darkness:
            tables["threshold"] = self.darkness.table, self.darkness.table_values
        if self.wants_displacement and self.displacement.loadable:
            tables["rest"] = self.displacement.table, self.displacement.table_values
        return tables

    def elaborate(self, platform):
        m = Module()
        m.submodules.guard = guard = self.guard
        m.submodules.background = background = self.background
        m.submodules.mlp = mlp = self.mlp
        m.submodules.normals_buffer = normals = SkidBuffer(self.normal_layout)
        connect(m, wiring.flipped(self.axis), guard.axis)
        connect(m, guard.tag, wiring.flipped(self.tag))
        connect(m, background.o, mlp.i)
        connect(m, mlp.o, normals.i)
        m.d.comb += [
            guard.enable.eq(self.enable),
            guard.timeout.eq(self.timeout),
            background.capture.eq(self.capture),
            self.captured.eq(background.captured),
            Cat(getattr(self, n) for n in (*EVENTS, *FRAME_FAULTS)).eq(
                Cat(getattr(guard, n) for n in (*EVENTS, *FRAME_FAULTS))
            ),
        ]

        m.submodules.validity = validity = self.validity
        connect(m, validity.verdict, wiring.flipped(self.verdict))
        m.d.comb += [
            validity.pixels.eq(guard.o.payload),
            validity.pixels_taken.eq(guard.o.valid & guard.o.ready),
            validity.features.eq(background.o.payload),
            validity.features_taken.eq(background.o.valid & background.o.ready),
            self.suspect_valid.eq(validity.suspect_valid),
            self.suspect.eq(validity.suspect),
        ]

        if self.loadable:
            m.d.comb += [
                guard.hold.eq(self.hold),
                mlp.parameters.eq(self.network),
                validity.limits.eq(self.limits),
            ]

        def fan_out(source, sinks, name):
            """Connect `source` to all `sinks`, through a Fork if there are several."""
            if len(sinks) == 1:
                connect(m, source, sinks[0])
                return
            m.submodules[name] = fork = Fork(source.payload.shape(), len(sinks))
            connect(m, source, fork.i)
            for output, sink in zip(fork.o, sinks, strict=True):
                connect(m, output, sink)

        scene = self.pipeline.scene
        fan_out(guard.o, [background.i, *([self.darkness.i] if scene.wants_darkness else [])], "pixels_fork")
        if scene.wants_darkness:
            m.submodules.darkness = darkness = self.darkness
            sinks = [self.dots.i] if scene.wants_dots else []
            if scene.wants_bridge:
                m.submodules.dark_queue = dark = DarkQueue(
                    darkness.windows, lanes=self.lanes, depth=self._dark_beats
                )
                sinks.append(dark.i)
            fan_out(darkness.o, sinks, "darkness_fork")
            if self.loadable:
                connect(m, wiring.flipped(self.threshold), darkness.threshold)
        sinks = [wiring.flipped(self.normals)] if self.wants_normals else []
        if scene.wants_slopes:
            m.submodules.divider = divider = self.divider
            slopes, over, saturated = divider.o, divider.over, divider.saturated
            if scene.wants_bridge:
                slopes, over, saturated = self._add_bridge(m, dark.o)
            m.d.comb += [
                self.gradient_saturated.eq(saturated),
                validity.slopes_over.eq(over),
                validity.slopes_taken.eq(slopes.valid & slopes.ready),
            ]
            sinks.append(divider.i)
        fan_out(normals.o, sinks, "normals_fork")
        if self.wants_force:
            m.submodules.force_stream = force = self.force_stream
            if scene.wants_dots:
                self._add_dots(m, force.o)
            else:
                connect(m, force.o, wiring.flipped(self.force))
        if scene.force_from_slopes:
            connect(m, slopes, force.i)
            if self.loadable:
                m.d.comb += force.constant.as_value().eq(self.constant)
        if not scene.wants_solver:
            return m

        m.submodules.solver = solver = self.solver
        m.submodules.solution_buffer = solution = SkidBuffer(solver.o.payload.shape())
        connect(m, slopes, solver.i)
        connect(m, solver.o, solution.i)
        if "offset" in self.loadable_tables:
            connect(m, wiring.flipped(self.offset), solver.offset)
        sinks = []
        if self.wants_depth:
            m.submodules.depth_output = depth = self.depth_output
            connect(m, depth.o, wiring.flipped(self.depth))
            sinks.append(depth.i)
        if self.wants_force:
            m.submodules.displacement = displacement = self.displacement
            connect(m, displacement.o, force.i)
            m.d.comb += [
                self.displacement_saturated.eq(displacement.saturated),
                validity.displacements_over.eq(displacement.over),
                validity.displacements_taken.eq(displacement.o.valid & displacement.o.ready),
            ]
            sinks.append(displacement.i)
            if displacement.loadable:
                connect(m, wiring.flipped(self.rest), displacement.rest)
        if self.wants_force_map:
            connect(m, force.map, wiring.flipped(self.force_map))
        fan_out(solution.o, sinks, "solution_fork")
        return m

    @property
    def _dark_beats(self) -> int:
        """Beats of pixels that are between the darkness and the slopes at most."""
        return self.background.latency + self.mlp.latency + self.divider.latency + 2 * SkidBuffer.latency + 2

    def _add_bridge(self, m: Module, dark) -> tuple:
        """Bridge the slopes of dark pixels; returns their stream, which saturated, and if any did."""
        m.submodules.bridge = bridge = self.bridge
        divider = self.divider
        slopes = stream.Signature(divider.o.payload.shape()).create()
        m.d.comb += [
            bridge.i.payload.slopes.eq(divider.o.payload),
            bridge.i.payload.over.as_value().eq(divider.over),
            bridge.i.payload.dark.eq(dark.payload),
            bridge.i.valid.eq(divider.o.valid & dark.valid),
            divider.o.ready.eq(bridge.i.ready & dark.valid),
            dark.ready.eq(bridge.i.ready & divider.o.valid),
            slopes.payload.eq(bridge.o.payload.slopes),
            slopes.valid.eq(bridge.o.valid),
            bridge.o.ready.eq(slopes.ready),
        ]
        over = bridge.o.payload.over.as_value()
        return slopes, over, bridge.o.valid & over.any()

    def _add_dots(self, m: Module, skin) -> None:
        """Follow the dots, and add their share to the force of the skin."""
        m.submodules.dots = dots = self.dots
        m.submodules.dot_force_stream = of_dots = self.dot_force_stream
        m.submodules.force_sum = force_sum = self.force_sum
        (shift,) = of_dots.i.payload
        m.d.comb += [
            shift[0].eq(dots.o.payload.u),
            shift[1].eq(dots.o.payload.v),
            of_dots.i.valid.eq(dots.o.valid),
            dots.o.ready.eq(of_dots.i.ready),
            self.validity.dot_lost.eq(~dots.o.payload.seen),
            self.validity.dot_taken.eq(dots.o.valid & dots.o.ready),
        ]
        connect(m, skin, force_sum.skin)
        connect(m, of_dots.o, force_sum.dots)
        connect(m, force_sum.o, wiring.flipped(self.force))
