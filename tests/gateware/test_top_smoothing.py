# amaranth: UnusedElaboratable=no
"""The top level with smoothed differences: the same integers, and cycles by formula."""

import numpy as np
import pytest
from top_hardware import Hardware, check_frames

from fastac.models.emulator.pipeline import Emulator

DESIGNS = {
    "one pixel": {"outputs": ("normals", "depth", "force_z"), "lanes": 1, "smoothing_px": 4},
    "four pixels and levelled light": {
        "outputs": ("depth", "force_xyz"),
        "lanes": 4,
        "size": 24,
        "smoothing_px": 8,
        "level_light": True,
        "solver": "tridiagonal",
        "source": "slopes",
        "coverage": 0.9,
    },
    "folded": {
        "outputs": ("depth", "force_xyz"),
        "lanes": "1/4",
        "smoothing_px": 2,
        "solver": "tridiagonal",
        "kernel": "collapsed",
        "clamp": False,
        "channels": "bgr+nir",
    },
    "normals": {"outputs": ("normals",), "lanes": 2, "smoothing_px": 8},
}


@pytest.mark.parametrize("name", DESIGNS)
@pytest.mark.full
def test_frames(tmp_path, name):
    hardware = Hardware(tmp_path, **DESIGNS[name])
    pipeline = hardware.pipeline
    images = hardware.frames(60)
    plain = pipeline.replace(
        scene=pipeline.scene.model_copy(
            update={"network": pipeline.scene.network.model_copy(update={"smoothing_px": 0})}
        )
    )
    smoothed, as_they_come = (Emulator(each).run(images).normal_words for each in (pipeline, plain))
    assert np.abs(smoothed - as_they_come).max() > 0
    check_frames(hardware)
