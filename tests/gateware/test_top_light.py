# amaranth: UnusedElaboratable=no
"""The top level with levelled light: photographs whose channels drift, back to back and with stalls."""

import numpy as np
import pytest
from top_hardware import Hardware, check_frames

from fastac.models.emulator.pipeline import Emulator


@pytest.mark.parametrize("lanes", [1, 4])
@pytest.mark.full
def test_drifting_frames(tmp_path, lanes):
    hardware = Hardware(tmp_path, outputs=("depth", "force_z"), lanes=lanes, level_light=True)
    check_frames(hardware)
    still = hardware.frames(*[5] * 24).astype(int)
    drift = np.array([1, -2, 0]) * np.arange(24)[:, None] // 4
    images = np.clip(still + drift[:, None, None], 0, 255).astype(np.uint8)
    seen = hardware.pipeline.seen(images)
    assert (seen[-1] != images[-1]).mean() > 0.5
    as_they_come, levelled = (Emulator(hardware.pipeline).run(each).depth_words for each in (images, seen))
    assert np.abs(levelled - as_they_come).max() > 0
    for stall in ((0, 0), (0.5, 0.3)):
        found = hardware.run(images, stall)
        assert found.mismatches == 0, f"stall {stall}: {found.first_mismatch}"
