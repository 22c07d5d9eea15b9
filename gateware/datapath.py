# amaranth: UnusedElaboratable=no
"""The datapath from pixels to normals, depth and force, with just the stages that a scene needs."""

from amaranth import Cat, Module, signed, unsigned
from amaranth.lib import data, stream, wiring
from amaranth.lib.wiring import In, Out, connect

from fastac.gateware import datapath_stages as stages
from fastac.gateware.bridged_slopes import BridgedSlopes
from fastac.gateware.dot_force import DotForceStream
from fastac.gateware.dot_slip import DotSlip
from fastac.gateware.dots.darkness import DarknessStream
from fastac.gateware.force.force_interval import ForceIntervalStream
from fastac.gateware.frame_cycles import FrameCycles
from fastac.gateware.loadable_parameters import LoadableParameters
from fastac.gateware.network.background import BackgroundSubtraction
from fastac.gateware.poisson.depth import DepthOutput, Displacement
from fastac.gateware.stream.fork import fan_out
from fastac.gateware.stream.frame_guard import EVENTS, FRAME_FAULTS, TIMEOUT_BITS, FrameGuard
from fastac.gateware.stream.frame_validity import FrameValidity
from fastac.gateware.stream.queues import SkidBuffer
from fastac.gateware.target.device import device_of
from fastac.models.integer.features import coordinate_codes
from fastac.models.integer.pipeline import IntegerPipeline

MARGIN = 4
"""Beats of darkness that are kept beyond those on their way to slopes: of the buffers' second places."""


class Datapath(FrameCycles, LoadableParameters, wiring.Component):
    """A bundle's integer pipeline as hardware, bit-exact to `IntegerPipeline.run`.

    Only what `pipeline.scene` needs is built: no slopes without depth and force, no solver for the adjoint,
    no transposer for the tridiagonal solver, no patches for the collapsed kernel, no dots unless the
    force is of them too. Products are packed for the DSP slices of the scene's part.

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
    half_widths : stream of one beat per frame, see ForceIntervalStream, after the frame's force has been
        taken and before the next one is offered. Only if the pipeline has an interval.
    slip : stream of one beat per frame, see `spread_layout`. Only if the scene has this output.
    force_map : stream of axes × `lanes` responses, signed(pipeline.force.pixel_width), in the depth's order.
        Only if the scene has this output.
    gradient_saturated, displacement_saturated : high while a beat with a clipped value is valid
    suspect_valid, suspect : see FrameValidity; a frame's pulse comes before its depth
    verdict : stream of a frame's flags, see FrameValidity; offered before the frame's last result
    hold : see FrameGuard. Like the following members only if the network is loadable.
    network : the network's parameters, see NormalMlp; folded, the write port of their table, see FoldedMlp
    offset : write port of the source's offsets. Only in mode "difference" with a solver.
    rest : write port of the depth at rest. Only in mode "absolute" with a force of the displacement.
    constant : that of a force of slopes, one accumulator per axis. Only with such a force.
    limits : limits of the flags, see FrameValidity
    threshold : write port of the thresholds of darkness. Only with dots or bridged slopes.
    dot_records : write port of what is known of each dot, see DotFollowerStream. Only with dots.
    contact_places, rigid_places : write ports of where dots are, see DotSlip. Only with slip.
    interval_base, interval_weights : base and write port, see ForceIntervalStream. Only with an interval.

    The loadable members must not change while a frame is in flight. FrameCycles has latencies and intervals.
    """

    def __init__(self, pipeline: IntegerPipeline):
        scene = pipeline.scene
        sensor, lanes = scene.sensor, scene.lanes
        height, width, channels = sensor.height_px, sensor.width_px, len(sensor.channel_names)
        self.pipeline, self.scene, self.lanes, self.fold = pipeline, scene, lanes, scene.fold
        self.guard = FrameGuard(height, width, channels, lanes=lanes)
        self.background = BackgroundSubtraction(
            height,
            width,
            channels,
            coordinate_codes(width),
            coordinate_codes(height),
            pipeline.background,
            lanes=lanes,
            level_light=sensor.level_light,
        )
        self.smoothing = stages.smoothing(pipeline)
        self.mlp = stages.pixel_network(pipeline)
        normal_width = pipeline.layers[-1].accumulator_width
        self.loadable = pipeline.layers[0].loadable
        self.wants_interval = scene.wants_interval
        if self.wants_interval and pipeline.interval is None:
            raise ValueError(f"force.coverage = {scene.force.coverage}: the pipeline has no interval")
        measured = pipeline.interval.pixel_measures if self.wants_interval else ()
        self.validity = FrameValidity(
            pipeline.validity, lanes=lanes, loadable=self.loadable, measured=measured
        )
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
        self.wants_displacement = scene.force_from_displacement
        self.rows_reversed = stages.rows_reversed(pipeline)
        depth = pipeline.depth
        if self.rows_reversed:
            depth = stages.last_row_first(depth)
        if self.wants_normals:
            members["normals"] = Out(stream.Signature(self.normal_layout))
        if scene.wants_slopes:
            self.divider = stages.divider(pipeline)
        if scene.wants_bridge:
            between = (self.background.latency, self.mlp.latency, SkidBuffer.latency, self.divider.latency)
            self.bridge = BridgedSlopes(
                pipeline.bridge,
                slope_bits=pipeline.ratio.width,
                lanes=lanes,
                fold=scene.fold,
                ahead=sum(between) + MARGIN,
            )
        if scene.wants_darkness:
            windows = (pipeline.bridge if scene.wants_bridge else pipeline.follower).windows
            self.darkness = DarknessStream(windows, lanes=lanes)
        if scene.wants_solver:
            self.solver = stages.solver(pipeline)
        if self.wants_depth:
            self.depth_output = DepthOutput(depth, lanes=lanes)
            members["depth"] = Out(self.depth_output.o.signature)
        if self.wants_displacement:
            self.displacement = Displacement(depth, pipeline.quantiser, lanes=lanes, loadable=self.loadable)
        if self.wants_force:
            self.force_stream = stages.force(pipeline)
            members["force"] = Out(self.force_stream.o.signature)
        if scene.wants_dots:
            self.dots = DotForceStream(pipeline, lanes=lanes, fold=scene.fold, dsp=device_of(scene).dsp)
            members["force"] = Out(self.dots.o.signature)
        if self.wants_interval:
            self.interval_stream = ForceIntervalStream(
                pipeline.interval,
                pipeline.validity,
                force_width=pipeline.force_width,
                loadable=self.loadable,
            )
            members["half_widths"] = Out(self.interval_stream.o.signature)
        if scene.wants_slip:
            word = self.displacement.o.payload.shape().elem_shape
            self.slip_stream = DotSlip(pipeline, word, lanes=lanes, rows_reversed=self.rows_reversed)
            members["slip"] = Out(self.slip_stream.o.signature)
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

    def elaborate(self, platform):
        m = Module()
        scene = self.pipeline.scene
        normals = self._network(m)
        self._validity(m)
        if self.loadable:
            self._load(m)
        self._darkness(m)
        sinks = [wiring.flipped(self.normals)] if self.wants_normals else []
        if scene.wants_slopes:
            slopes = self._slopes(m)
            sinks.append(self.divider.i)
        fan_out(m, "normals_fork", normals.o, sinks)
        if self.wants_force:
            self._force(m)
        sinks = [self.force_stream.i] if scene.force_from_slopes else []
        if scene.wants_solver:
            sinks.append(self.solver.i)
        if scene.wants_slopes:
            fan_out(m, "slopes_fork", slopes, sinks)
        if scene.wants_solver:
            self._solution(m)
        return m

    def _network(self, m: Module) -> SkidBuffer:
        """From the pixels to the normals in the buffer that is returned."""
        m.submodules.guard = guard = self.guard
        m.submodules.background = background = self.background
        m.submodules.mlp = mlp = self.mlp
        m.submodules.normals_buffer = normals = SkidBuffer(self.normal_layout)
        connect(m, wiring.flipped(self.axis), guard.axis)
        connect(m, guard.tag, wiring.flipped(self.tag))
        features = background.o
        if self.smoothing is not None:
            m.submodules.smoothing = smoothing = self.smoothing
            connect(m, features, smoothing.i)
            features = smoothing.o
        connect(m, features, mlp.i)
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
        return normals

    def _validity(self, m: Module) -> None:
        """What says whether a frame's values can be trusted, as far as it sees pixels and features."""
        m.submodules.validity = validity = self.validity
        connect(m, validity.verdict, wiring.flipped(self.verdict))
        background, guard = self.background, self.guard
        seen, pixels = guard.o, guard.o.payload
        if background.level_light:
            seen, pixels = background.o, background.shifted
        m.d.comb += [
            validity.pixels.eq(pixels),
            validity.pixels_taken.eq(seen.valid & seen.ready),
            validity.features.eq(background.o.payload),
            validity.features_taken.eq(background.o.valid & background.o.ready),
            self.suspect_valid.eq(validity.suspect_valid),
            self.suspect.eq(validity.suspect),
        ]

    def _load(self, m: Module) -> None:
        """What a calibration sets of the network and of the flags."""
        m.d.comb += [self.guard.hold.eq(self.hold), self.validity.limits.eq(self.limits)]
        if self.fold > 1:
            connect(m, wiring.flipped(self.network), self.mlp.parameters)
        else:
            m.d.comb += self.mlp.parameters.eq(self.network)

    def _darkness(self, m: Module) -> None:
        """The pixels to the network and, with dots or bridged slopes, to what finds dark places in them."""
        scene = self.pipeline.scene
        sinks = [self.background.i]
        if scene.wants_darkness:
            sinks.append(self.darkness.i)
        fan_out(m, "pixels_fork", self.guard.o, sinks)
        if not scene.wants_darkness:
            return
        m.submodules.darkness = darkness = self.darkness
        sinks = [self.dots.darkness] if scene.wants_dots else []
        sinks += [self.bridge.darkness] if scene.wants_bridge else []
        fan_out(m, "darkness_fork", darkness.o, sinks)
        if self.loadable:
            connect(m, wiring.flipped(self.threshold), darkness.threshold)

    def _slopes(self, m: Module):
        """The stream of slopes, bridged under dots where the scene wants it."""
        m.submodules.divider = divider = self.divider
        slopes, over, saturated = divider.o, divider.over, divider.saturated
        if self.pipeline.scene.wants_bridge:
            m.submodules.bridge = bridge = self.bridge
            connect(m, slopes, bridge.slopes)
            m.d.comb += bridge.over.eq(over)
            slopes, over, saturated = bridge.o, bridge.o_over, bridge.saturated
        m.d.comb += [
            self.gradient_saturated.eq(saturated),
            self.validity.slopes_over.eq(over),
            self.validity.slopes_taken.eq(slopes.valid & slopes.ready),
        ]
        return slopes

    def _force(self, m: Module) -> None:
        """From the skin's force, whose input is connected elsewhere, to the force of the frame."""
        m.submodules.force_stream = force = self.force_stream
        found = force.o
        if self.pipeline.scene.wants_dots:
            m.submodules.dots = dots = self.dots
            connect(m, found, dots.skin)
            m.d.comb += [self.validity.dot_lost.eq(dots.lost), self.validity.dot_taken.eq(dots.taken)]
            found = dots.o
            if self.loadable:
                connect(m, wiring.flipped(self.dot_records), dots.write)
        if self.wants_interval:
            found = self._with_interval(m, found)
        connect(m, found, wiring.flipped(self.force))
        if self.loadable and self.pipeline.scene.force_from_slopes:
            m.d.comb += force.constant.as_value().eq(self.constant)

    def _solution(self, m: Module) -> None:
        """From the solver to depth and displacement."""
        m.submodules.solver = solver = self.solver
        m.submodules.solution_buffer = solution = SkidBuffer(solver.o.payload.shape())
        connect(m, solver.o, solution.i)
        if "offset" in self.loadable_tables:
            connect(m, wiring.flipped(self.offset), solver.offset)
        sinks = []
        if self.wants_depth:
            m.submodules.depth_output = depth = self.depth_output
            connect(m, depth.o, wiring.flipped(self.depth))
            sinks.append(depth.i)
        if self.wants_displacement:
            self._displacement(m)
            sinks.append(self.displacement.i)
        if self.wants_force_map:
            connect(m, self.force_stream.map, wiring.flipped(self.force_map))
        fan_out(m, "solution_fork", solution.o, sinks)

    def _displacement(self, m: Module) -> None:
        """The displacement, to the force and, where the scene wants it, to what finds slip."""
        m.submodules.displacement = displacement = self.displacement
        consumers = [self.force_stream.i]
        if self.pipeline.scene.wants_slip:
            m.submodules.slip_stream = slip = self.slip_stream
            connect(m, self.dots.shifts, slip.dots)
            connect(m, slip.o, wiring.flipped(self.slip))
            consumers.append(slip.displacement)
            if self.loadable:
                for name in slip.tables:
                    connect(m, wiring.flipped(getattr(self, name)), getattr(slip, name))
        fan_out(m, "displacement_fork", displacement.o, consumers)
        m.d.comb += [
            self.displacement_saturated.eq(displacement.saturated),
            self.validity.displacements_over.eq(displacement.over),
            self.validity.displacements_taken.eq(displacement.o.valid & displacement.o.ready),
        ]
        if displacement.loadable:
            connect(m, wiring.flipped(self.rest), displacement.rest)

    def _with_interval(self, m: Module, found):
        """Find the half-widths of the forces `found`; returns them as they are offered: one at a time."""
        m.submodules.interval_stream = interval = self.interval_stream
        offered = found.signature.create(path=("offered_force",))
        taken = offered.valid & offered.ready
        m.d.comb += [
            offered.payload.eq(found.payload),
            offered.valid.eq(found.valid & interval.room),
            found.ready.eq(offered.ready & interval.room),
            interval.force.eq(found.payload),
            interval.force_taken.eq(taken),
        ]
        for stage in interval.groups:
            for member in (f"{stage}_measures", f"{stage}_measured"):
                m.d.comb += getattr(interval, member).eq(getattr(self.validity, member))
        connect(m, interval.o, wiring.flipped(self.half_widths))
        if self.loadable:
            m.d.comb += interval.base.as_value().eq(self.interval_base)
            connect(m, wiring.flipped(self.interval_weights), interval.weights)
        return offered
