"""Latency, interval and multipliers of a whole datapath from those of its stages."""

from fastac.gateware.force.force_sum import ForceSum
from fastac.gateware.stream.queues import SkidBuffer
from fastac.scenes.schema import Scene

OF_FORCE = ("force", "dots", "slip")
"""Stages that only the force, and slip beside it, pass."""


class FrameCycles:
    """Mixin that adds up its stages' latencies, intervals and multipliers, for Datapath and CycleModel.

    The inheriting class has `scene`, `lanes` and, as far as the scene needs them, `guard`, `background`,
    `mlp`, `divider`, `solver` (with `stages` instead of `latency`), `depth_output`, `displacement`,
    `force_stream`, `bridge`, `darkness`, `dots` and `slip_stream`, each with `latency`, `interval` and
    `multipliers`; `dots` is as `DotForceStream`, which also has `followed`.

    All times are in clocks, without back-pressure and with no other frame in the way. `stages` has each
    stage's share of the time from a frame's first pixel to its last result.
    """

    scene: Scene
    lanes: int

    @property
    def beats(self) -> int:
        """Input beats per frame."""
        return self.scene.sensor.height_px * self.scene.sensor.width_px // self.lanes

    @property
    def stages(self) -> dict[str, int]:
        stages = self._stages_without_dots
        if not self.scene.wants_dots:
            return stages
        # The dots are found beside the rest: what counts is how much later than the skin's they are.
        skin, dark = sum(stages.values()), self.guard.latency + self.beats - 1 + self.darkness.latency
        stages["dots"] = max(dark + self.dots.latency - skin, 0) + ForceSum.latency
        if self.scene.wants_slip:
            displaced = skin - self.force_stream.latency
            slip = max(displaced, dark + self.dots.followed) + self.slip_stream.latency
            stages["slip"] = max(slip - sum(stages.values()), 0)
        return stages

    @property
    def _stages_without_dots(self) -> dict[str, int]:
        scene = self.scene
        slopes = {"gradients": self.divider.latency} if scene.wants_slopes else {}
        if scene.wants_bridge:
            slopes["bridge"] = self.bridge.latency
        if not scene.wants_solver:
            stages = {"normals": self.first_pixel_to_normals} | slopes
            if scene.force_from_slopes:
                stages["force"] = self.force_stream.latency
            return stages
        stages = {"normals": self.first_pixel_to_normals - (self.beats - 1)} | slopes
        stages |= self.solver.stages
        stages["solution_buffer"] = SkidBuffer.latency
        if scene.wants_force:
            stages["force"] = self.displacement.latency + self.force_stream.latency
        return stages

    @property
    def modules(self) -> dict[str, int]:
        """Shares of the paper's three modules in the latency from first pixel to force, or else to depth."""
        stages, scene = self.stages, self.scene
        share = {"normals": stages["normals"]}
        if scene.wants_solver:
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
        return first + self.beats - 1

    @property
    def first_pixel_to_depth(self) -> int:
        """Clocks from a frame's first accepted pixel to its last beat of depth."""
        before = sum(v for k, v in self.stages.items() if k not in OF_FORCE)
        return before + self.depth_output.latency

    @property
    def first_pixel_to_force(self) -> int:
        """Clocks from a frame's first accepted pixel to its force."""
        return sum(self.stages.values())

    @property
    def last_pixel_to_force(self) -> int:
        """Clocks from a frame's last accepted pixel to its force."""
        return self.first_pixel_to_force - (self.beats - 1)

    @property
    def interval(self) -> int:
        """Initiation interval: clocks from frame to frame at full rate."""
        intervals = [self.beats]
        if self.scene.wants_solver:
            intervals.append(self.solver.interval)
        if self.scene.wants_force:
            intervals.append(self.force_stream.interval)
        if self.scene.wants_dots:
            intervals.append(self.dots.interval)
        if self.scene.wants_slip:
            intervals.append(self.slip_stream.interval)
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
        return count
