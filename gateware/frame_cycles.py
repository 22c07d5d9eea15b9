"""A frame's cycles from those of its stages: the same sums for components and for a scene's figures."""

from fastac.gateware.stream.queues import SkidBuffer
from fastac.scenes.schema import Scene


class FrameCycles:
    """What the latencies, intervals and multipliers of a datapath's parts come to.

    Whoever inherits this has `scene`, `lanes`, and with `latency`, `interval` and `multipliers`, as far as
    the scene wants them: `guard`, `background`, `mlp`, `divider`, `solver` (`stages` in place of a latency),
    `depth_output`, `displacement`, `force_stream`.

    `stages` gives each stage's share, in clocks, of the way from a frame's first pixel accepted to its last
    value, if nothing stalls and no other frame is in the way.
    """

    scene: Scene
    lanes: int

    @property
    def beats(self) -> int:
        """Of a frame."""
        return self.scene.sensor.height_px * self.scene.sensor.width_px // self.lanes

    @property
    def stages(self) -> dict[str, int]:
        scene = self.scene
        if not scene.wants_solver:
            stages = {"normals": self.first_pixel_to_normals}
            if scene.force_from_slopes:
                stages |= {"gradients": self.divider.latency, "force": self.force_stream.latency}
            return stages
        stages = {"normals": self.first_pixel_to_normals - (self.beats - 1)}
        stages["gradients"] = self.divider.latency
        stages |= self.solver.stages
        stages["solution_buffer"] = SkidBuffer.latency
        if scene.wants_force:
            stages["force"] = self.displacement.latency + self.force_stream.latency
        return stages

    @property
    def modules(self) -> dict[str, int]:
        """The three modules' shares of the way from first pixel to force, or to depth where that is last."""
        stages, scene = self.stages, self.scene
        share = {"normals": stages["normals"]}
        if scene.wants_solver:
            share["depth"] = sum(v for k, v in stages.items() if k not in ("normals", "force"))
            if not scene.wants_force:
                share["depth"] += self.depth_output.latency
        if scene.wants_force:
            share["force"] = stages["force"] + (stages["gradients"] if "depth" not in share else 0)
        return share

    @property
    def first_pixel_to_normals(self) -> int:
        """Clocks from the first pixel accepted to the last normals offered."""
        first = self.guard.latency + self.background.latency + self.mlp.latency + SkidBuffer.latency
        return first + self.beats - 1

    @property
    def first_pixel_to_depth(self) -> int:
        """Clocks from the first pixel accepted to the last depth offered."""
        before = sum(v for k, v in self.stages.items() if k != "force")
        return before + self.depth_output.latency

    @property
    def first_pixel_to_force(self) -> int:
        """Clocks from the first pixel accepted to the force offered."""
        return sum(self.stages.values())

    @property
    def last_pixel_to_force(self) -> int:
        """Clocks from the last pixel accepted to the force offered."""
        return self.first_pixel_to_force - (self.beats - 1)

    @property
    def interval(self) -> int:
        """Clocks between frames when they follow each other without a gap."""
        intervals = [self.beats]
        if self.scene.wants_solver:
            intervals.append(self.solver.interval)
        if self.scene.wants_force:
            intervals.append(self.force_stream.interval)
        return max(intervals)

    @property
    def multipliers(self) -> dict[str, int]:
        """Products a clock, by stage, as the architecture has them."""
        count = {"normals": self.mlp.multipliers}
        if self.scene.wants_solver:
            count["depth"] = self.solver.multipliers
        if self.scene.wants_force:
            count["force"] = self.force_stream.multipliers
        return count
