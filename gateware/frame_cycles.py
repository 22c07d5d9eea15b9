"""Latency, interval and multipliers of a whole datapath from those of its stages."""

from fastac.gateware.bus.record import record_form
from fastac.gateware.force.force_sum import ForceSum
from fastac.gateware.force.patch_generator import PatchGenerator
from fastac.gateware.packets.record_beats import RecordBeats
from fastac.gateware.packets.record_queue import RecordQueue
from fastac.gateware.raster_outputs import RasterOutput, scene_outputs
from fastac.gateware.stream.frame_validity import FrameValidity
from fastac.gateware.stream.queues import SkidBuffer
from fastac.scenes.outputs import OUTPUTS
from fastac.scenes.schema import Scene

OF_FORCE = ("force", "dots", "slip")
"""Stages that only the force, and slip beside it, pass."""
RESULTS = "results"
"""Name of the stream of records without images, of scenes that have no image output."""
RECORD_LATENCY = 1
"""Clocks from a result to its record at the outputs of RegisterBlock."""
RESULT_TO_RECORD = RECORD_LATENCY + RecordQueue.latency + RecordBeats.latency
"""Clocks from a result, with an interval from its half-widths, to the first beat of its record, if that need
not wait for an image."""
RESULTS_WORD_BYTES = 4
"""Bytes per beat of the stream of records without images."""


class FrameCycles:
    """Mixin that adds up its stages' latencies, intervals and multipliers, for Datapath and CycleModel.

    The inheriting class has `scene`, `lanes`, `fold`, `smoothing`, which may be None, and, as far as the
    scene needs them, `guard`, `background`, `mlp`, `divider`, `solver` (with `stages` instead of `latency`),
    `depth_output`, `displacement`, `force_stream`, `bridge`, `darkness`, `dots`, `slip_stream` and
    `interval_stream`, each with `latency`, `interval` and `multipliers`; `dots` is as `DotForceStream`, which
    also has `followed`, the force of a map has its `map_latency`, and `interval_stream` has `products`.
    `wants_interval`: whether there is the last one.

    All times are in clocks, without back-pressure and with no other frame in the way; beats enter `fold`
    clocks apart. `stages` has each stage's share of the time from a frame's first pixel to its last result.
    """

    scene: Scene
    lanes: int
    fold: int
    wants_interval: bool

    @property
    def beats(self) -> int:
        """Input beats per frame."""
        return self.scene.sensor.height_px * self.scene.sensor.width_px // self.lanes

    @property
    def input_clocks(self) -> int:
        """Clocks from a frame's first accepted pixel to its last."""
        return (self.beats - 1) * self.fold

    @property
    def stages(self) -> dict[str, int]:
        """Those on the way to the last result: to the depth, where the force does not wait for it."""
        return self._depth_stages if self.scene.force_beside_depth else self.force_stages

    @property
    def force_stages(self) -> dict[str, int]:
        """Those on the way to the force, or without a force to depth or normals."""
        stages = self._skin_stages
        if not self.scene.wants_dots:
            return stages
        # The dots are found beside the rest: what counts is how much later than the skin's they are.
        skin, dark = sum(stages.values()), self.guard.latency + self.input_clocks + self.darkness.latency
        stages["dots"] = max(dark + self.dots.latency - skin, 0) + ForceSum.latency
        if self.scene.wants_slip:
            displaced = skin - self.force_stream.latency
            slip = max(displaced, dark + self.dots.followed) + self.slip_stream.latency
            stages["slip"] = max(slip - sum(stages.values()), 0)
        return stages

    @property
    def _skin_stages(self) -> dict[str, int]:
        """Those on the way to the skin's force, or without a force to depth or normals."""
        scene = self.scene
        if scene.wants_solver and not scene.force_from_slopes:
            stages = self._depth_stages
            if scene.wants_force:
                stages["force"] = self.displacement.latency + self.force_stream.latency
            return stages
        stages = {"normals": self.first_pixel_to_normals} | self._slope_stages
        if scene.force_from_slopes:
            stages["force"] = self.force_stream.latency
        return stages

    @property
    def _slope_stages(self) -> dict[str, int]:
        """Those between normals and slopes."""
        stages = {"gradients": self.divider.latency} if self.scene.wants_slopes else {}
        if self.scene.wants_bridge:
            stages["bridge"] = self.bridge.latency
        return stages

    @property
    def _depth_stages(self) -> dict[str, int]:
        """Those on the way to the solution of Poisson's equation."""
        normals = {"normals": self.first_pixel_to_normals - self.input_clocks}
        last = {"solution_buffer": SkidBuffer.latency}
        return normals | self._slope_stages | self.solver.stages | last

    @property
    def modules(self) -> dict[str, int]:
        """Shares of the paper's three modules in the latency from first pixel to force, or else to depth."""
        stages, scene = self.force_stages, self.scene
        share = {"normals": stages["normals"]}
        if scene.wants_solver and not scene.force_beside_depth:
            share["depth"] = sum(v for k, v in stages.items() if k not in ("normals", *OF_FORCE))
            if not scene.wants_force:
                share["depth"] += self.depth_output.latency
        if scene.wants_force:
            share["force"] = sum(stages.get(k, 0) for k in OF_FORCE)
            if "depth" not in share:
                share["force"] += stages["gradients"] + stages.get("bridge", 0)
        return share

    @property
    def first_pixel_to_normals(self) -> int:
        """Clocks from a frame's first accepted pixel to its last beat of normals."""
        first = self.guard.latency + self.background.latency + self.mlp.latency + SkidBuffer.latency
        if self.smoothing is not None:
            first += self.smoothing.latency
        return first + self.input_clocks

    @property
    def first_pixel_to_depth(self) -> int:
        """Clocks from a frame's first accepted pixel to its last beat of depth."""
        before = sum(v for k, v in self.stages.items() if k not in OF_FORCE)
        return before + self.depth_output.latency

    @property
    def first_pixel_to_force(self) -> int:
        """Clocks from a frame's first accepted pixel to its force."""
        return sum(self.force_stages.values())

    @property
    def last_pixel_to_force(self) -> int:
        """Clocks from a frame's last accepted pixel to its force."""
        return self.first_pixel_to_force - self.input_clocks

    @property
    def force_to_half_widths(self) -> int:
        """Clocks from a frame's force to its half-widths, which wait for the frame's measures if these are
        later."""
        stream, channels = self.interval_stream, len(self.scene.sensor.channel_names)
        normals = self.first_pixel_to_normals - self.input_clocks
        last = {
            "features": self.guard.latency + self.background.latency,
            "slopes": normals + sum(self._slope_stages.values()),
        }
        due = 0
        for stage, count in stream.products.items():
            measured = FrameValidity.measured_latency(stage, channels, self.lanes)
            due = max(due, last[stage] + measured + 1) + count
        return max(stream.latency, due + stream.latency - 1 - self.last_pixel_to_force)

    @property
    def first_pixel_to_force_map(self) -> int:
        """Clocks from a frame's first accepted pixel to its last beat of the force map."""
        return self.first_pixel_to_force - (self.force_stream.latency - self.force_stream.map_latency)

    @property
    def first_pixel_to_result(self) -> int:
        """Clocks from a frame's first accepted pixel to its force, or without one to its depth or normals."""
        if self.scene.wants_force:
            return self.first_pixel_to_force
        return self.first_pixel_to_depth if self.scene.wants_solver else self.first_pixel_to_normals

    @property
    def packets(self) -> dict[str, RasterOutput]:
        """The image outputs by name with hardware.streams "packets", else none."""
        if self.scene.hardware.streams != "packets":
            return {}
        return {output.name: output for output in scene_outputs(self.scene, rows_reversed=False)}

    @property
    def first_pixel_to_packet(self) -> dict[str, int]:
        """Clocks from a frame's first accepted pixel to the last beat of each packet, trailer included."""
        if self.scene.hardware.streams != "packets":
            return {}
        if not self.packets:
            beats = record_form(self.wants_interval).bytes // RESULTS_WORD_BYTES
            return {RESULTS: self._first_pixel_to_record + beats - 1}
        return {
            name: self._trailer_at(output) + output.packet.trailer_beats - 1
            for name, output in self.packets.items()
        }

    def _trailer_at(self, output: RasterOutput) -> int:
        """Clocks to the first beat of the trailer: behind the image, and not before the record is there."""
        behind = getattr(self, f"first_pixel_to_{output.name}") + 1
        return max(behind, self._first_pixel_to_record) if output.complete else behind

    @property
    def _first_pixel_to_record(self) -> int:
        """Clocks to the first beat of a record that need not wait for an image."""
        found = self.first_pixel_to_result + RESULT_TO_RECORD
        return found + self.force_to_half_widths if self.wants_interval else found

    @property
    def frame_pause(self) -> int:
        """Clocks after a frame in which the input is not ready: what the longest packet has over a frame's
        beats.

        Normals fill their stream, so that their trailer needs clocks without a beat. Taken here, before the
        first pixel, they delay no frame that has begun.
        """
        clocks = self.beats * self.fold
        return max((0, *(output.packet.beats - clocks for output in self.packets.values())))

    @property
    def look_ahead(self) -> int:
        """Beats of the next frame's displacement that a frame's force may need to be pushed out, see
        PatchGenerator."""
        scene = self.scene
        if not (scene.force_from_displacement and scene.force.kernel == "patch"):
            return 0
        return PatchGenerator.reach_of(scene.inner_px, scene.force.kernel_size, self.lanes)

    def packet_queue(self, name: str) -> int:
        """Places of the queue for beats of the next image that come before a packet's trailer has ended; 0:
        none.

        So images flow on while a trailer waits for its record: at full rate they come with `interval` less
        their own clocks between them. No frame makes it longer, as a packet has at most `interval` beats. One
        more place, as a full queue takes no beat in the clock in which it gives one.

        Once the next image has begun, a force of patches goes on only with its beats (`look_ahead`). These
        come through the same fork as the image's, however close the frames are, so the queue has a place for
        each: else the trailer would wait for a force that waits for the trailer.
        """
        output = self.packets[name]
        waits = self._trailer_at(output) - getattr(self, f"first_pixel_to_{name}") - 1
        gap = self.interval - ((output.rows * output.beats - 1) * self.fold + 1)
        kept = -(-(waits + output.packet.trailer_beats - gap) // self.fold)
        pushing = self.look_ahead if output.complete and not OUTPUTS[name].needs_patches else 0
        return max(kept + 1 if kept > 0 else 0, pushing)

    @property
    def interval(self) -> int:
        """Initiation interval: clocks from frame to frame at full rate."""
        intervals = [self.beats * self.fold + self.frame_pause]
        if self.scene.wants_solver:
            intervals.append(self.solver.interval)
        if self.scene.wants_force:
            intervals.append(self.force_stream.interval)
        if self.scene.wants_dots:
            intervals.append(self.dots.interval)
        if self.scene.wants_slip:
            intervals.append(self.slip_stream.interval)
        if self.wants_interval:
            intervals.append(self.interval_stream.interval)
        return max(intervals)

    @property
    def multipliers(self) -> dict[str, int]:
        """Number of DSP slices of the scene's part by module, as in the architecture, before synthesis."""
        count = {"normals": self.mlp.multipliers}
        if self.scene.wants_solver:
            count["depth"] = self.solver.multipliers
        if self.scene.wants_force:
            count["force"] = self.force_stream.multipliers
        if self.scene.wants_dots:
            count["dots"] = self.dots.multipliers
        if self.scene.wants_slip:
            count["slip"] = self.slip_stream.multipliers
        if self.wants_interval:
            count["interval"] = self.interval_stream.multipliers
        return count
