# amaranth: UnusedElaboratable=no
"""The times of the stages are those that the simulated datapath has."""

import numpy as np
import pytest
from amaranth import Cat
from amaranth.sim import Simulator

from fastac.gateware.datapath import Datapath
from fastac.models.random_bundle import random_bundle, scene
from fastac.report import timeline
from fastac.report.timeline import StageTime
from fastac.scenes.pace import Pace

BUFFERED = ("normals", "source", "column_forward", "division", "substitution")
"""A skid buffer stands behind these; its clock is theirs, so that their own outputs are one earlier."""
SIZE = 16


def streams(path: Datapath) -> dict:
    """The stages' output streams by name."""
    found = {"normals": path.mlp.o, "gradients": path.divider.o}
    if path.scene.wants_solver:
        found |= {name: getattr(path.solver, name).o for name in path.solver.stages}
    return found | {"force": path.force}


def observed(path: Datapath) -> dict[str, list[int]]:
    """Clocks of each stage's outputs for one frame and the beginning of the next, from the first pixel."""
    beats, channels = SIZE * SIZE // path.lanes, len(path.scene.sensor.channel_names)
    frame = np.random.default_rng(1).integers(0, 256, (beats, path.lanes * channels), np.uint8)
    outputs = streams(path)
    times = {name: [] for name in ("pixels", *outputs)}
    simulator = Simulator(path)
    simulator.add_clock(1e-8)

    async def camera(ctx):
        for name in ("force", "verdict", "tag"):
            ctx.set(getattr(path, name).ready, 1)
        ctx.set(path.axis.tvalid, 1)
        for beat in range(2 * beats):
            ctx.set(path.axis.tdata, int.from_bytes(frame[beat % beats].tobytes(), "little"))
            ctx.set(path.axis.tlast, (beat + 1) % (SIZE // path.lanes) == 0)
            ctx.set(path.axis.tuser, beat % beats == 0)
            *_, taken = await ctx.tick().sample(path.axis.tready)
            while not taken:
                *_, taken = await ctx.tick().sample(path.axis.tready)

    async def watch(ctx):
        handshakes = Cat(
            path.axis.tvalid & path.axis.tready, *(each.valid & each.ready for each in outputs.values())
        )
        clock = 0
        while not times["force"]:
            *_, moved = await ctx.tick().sample(handshakes)
            for k, found in enumerate(times.values()):
                if moved >> k & 1:
                    found.append(clock)
            clock += 1
            assert clock < 5000

    simulator.add_testbench(watch)
    simulator.add_testbench(camera, background=True)
    simulator.run()
    return {name: [clock - times["pixels"][0] for clock in found] for name, found in times.items()}


@pytest.mark.parametrize(
    "changes",
    [
        {"outputs": ("force_z",)},
        {"outputs": ("force_z",), "solver": "tridiagonal", "kernel": "collapsed", "lanes": 2},
        {"outputs": ("force_xyz",), "solver": "adjoint"},
    ],
    ids=["dst2d", "tridiagonal, 2 lanes", "adjoint"],
)
def test_first_and_last_outputs_are_those_of_the_simulated_datapath(changes, tmp_path):
    wanted = scene(**changes, weights="baked")
    path = Datapath(random_bundle(tmp_path, wanted).pipeline)
    found = {stage.name: stage for stage in timeline.of_scene(wanted, {"stage": path.stages})}
    outputs = {"normals": SIZE * SIZE // path.lanes, "gradients": SIZE * SIZE // path.lanes, "force": 1}
    inner = (SIZE - 2) * -(-(SIZE - 2) // path.lanes)
    times = observed(path)
    for name in streams(path):
        first, last = times[name][0], times[name][outputs.get(name, inner) - 1]
        later = name in BUFFERED
        assert (found[name].first, found[name].last) == (first + later, last + later), name
    assert found[timeline.PIXELS].last == SIZE * SIZE // path.lanes - 1


def test_modules_add_up_to_the_whole_time():
    stages = {"normals": 27, "gradients": 11, "source": 261, "row_forward": 21, "force": 32, "slip": 5}
    found = timeline.of_image(stages, 16, 16, Pace())
    assert timeline.modules(found) == {"normals": 27, "depth": 293, "force": 37}
    assert found[-1] == StageTime("slip", "force", 5, 357, 357)
    without_solver = timeline.of_image({"normals": 282, "gradients": 11, "force": 7}, 16, 16, Pace())
    assert timeline.modules(without_solver) == {"normals": 282, "force": 18}
