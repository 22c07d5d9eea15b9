# amaranth: UnusedElaboratable=no
"""Hardware built from one bundle computes like another one after its calibration has been loaded."""

import json

import numpy as np
import pytest

from fastac.gateware.calibration import calibration_words
from fastac.gateware.target.elaboration import to_verilog
from fastac.gateware.top_zynq import TopZynq
from fastac.models.emulator.pipeline import Emulator
from fastac.models.random_bundle import frames, random_bundle, recalibrated, scene
from fastac.models.result import concatenate
from fastac.sim.check_top import bench_settings, expected_words
from fastac.sim.runner import QUICK, build

NAME = "fastac"
SPANS = (10, 5, 60)
"""Largest difference of each frame from the background."""


@pytest.mark.parametrize(
    "wanted",
    [
        {"outputs": ("depth", "force_z"), "mode": "absolute", "lanes": 2},
        {"outputs": ("normals", "depth", "force_z"), "mode": "difference", "solver": "tridiagonal"},
        {
            "outputs": ("force_x", "force_z"),
            "mode": "difference",
            "solver": "adjoint",
            "lanes": 4,
            "coverage": 0.9,
        },
        {
            "outputs": ("force_x", "force_z"),
            "solver": "adjoint",
            "dots": True,
            "bridge_dots": True,
            "size": 24,
        },
        {
            "outputs": ("depth", "force_x", "force_z", "slip"),
            "solver": "tridiagonal",
            "kernel": "collapsed",
            "dots": True,
            "lanes": 2,
            "size": 24,
        },
        {
            "outputs": ("depth", "force_xyz"),
            "mode": "difference",
            "solver": "tridiagonal",
            "source": "slopes",
            "lanes": "1/4",
        },
    ],
    ids=["absolute depth", "difference from the background", "adjoint", "dots", "slip", "folded"],
)
@pytest.mark.quick("difference from the background")
@pytest.mark.long
def test_frames_use_the_loaded_calibration(tmp_path, wanted):
    """With AXI error responses, so that the host sees which of its words is refused."""
    own = random_bundle(tmp_path / "own", scene(**wanted, bus_errors="respond"))
    other = recalibrated(tmp_path / "other", own)
    top = TopZynq(own)
    source = tmp_path / f"{NAME}.v"
    source.write_text(to_verilog(top, name=NAME))

    images = frames(own.pipeline.background, SPANS)
    results = [Emulator(bundle.pipeline).run(images) for bundle in (own, other)]
    for name in ("normal_words", "depth_words", "force_raw", "force_half_width_raw"):
        found = [getattr(result, name) for result in results]
        assert found[0] is None or (found[0] != found[1]).any(axis=tuple(range(1, found[0].ndim))).all()
    result = concatenate(results)
    archive = {"frames": np.concatenate([images, images]), **expected_words(top, result)}
    if top.identity.slip:
        archive |= {"SLIP_SPREAD": result.slip_words, "SLIP_DOTS": result.slip_dots}
        archive["slipping"] = result.slipping
        assert (results[0].slip_words != results[1].slip_words).any()
    if own.pipeline.interval is not None:
        archive["half_widths"] = result.force_half_width_raw
    np.savez(tmp_path / "frames.npz", **archive, force=result.force_raw, validity=result.validity)
    assert (results[0].validity != results[1].validity).any()
    settings = bench_settings(top) | {
        "timeout_cycles": 60_000,
        "row_order": next((o.row_order for o in top.outputs if o.tagged), None),
        "own": [0, 1, 2],
        "other": [3, 4, 5],
        "hash": {"own": own.hash_word, "other": other.hash_word},
        "words": {
            "own": calibration_words(own, own).tolist(),
            "other": calibration_words(other, own).tolist(),
        },
    }
    (tmp_path / "settings.json").write_text(json.dumps(settings))
    runner = build(source, NAME, tmp_path / "build", build_args=QUICK)
    runner.test(
        hdl_toplevel=NAME,
        test_module="fastac.sim.benches.top_calibration",
        build_dir=tmp_path / "build",
        extra_env={"BENCH": str(tmp_path)},
    )


@pytest.mark.parametrize("mode", ["absolute", "difference"])
@pytest.mark.quick("absolute")
def test_baked_hardware_has_no_calibration_logic(tmp_path, mode):
    outputs = ("depth", "force_z")
    baked = TopZynq(random_bundle(tmp_path / "baked", scene(outputs, mode=mode, weights="baked")))
    loadable = TopZynq(random_bundle(tmp_path / "loadable", scene(outputs, mode=mode)))
    for top, found in ((baked, False), (loadable, True)):
        path = top.datapath
        assert any("CALIBRATION" in register.name for register in top.identity.registers) == found
        assert bool(path.loadable_tables) == bool(path.loadable_registers) == found
        ports = {"hold", "network", "constant", "offset", "rest"} & set(path.signature.members)
        assert ports == ({"hold", "network", *path.loadable_tables} if found else set())
        assert ("calibration" in to_verilog(top, name=NAME)) == found
