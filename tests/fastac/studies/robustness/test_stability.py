# amaranth: UnusedElaboratable=no
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from fastac.cli.main import main
from fastac.flow import hardware
from fastac.models.emulator.pipeline import Emulator
from fastac.models.loops.frames import CHUNK
from fastac.studies.robustness import stability


@pytest.fixture(scope="module")
def frames(tiny_data):
    return tiny_data.frames[tiny_data.indices("test")]


def test_frames_drift_and_the_first_recurs(frames):
    found = stability.perturbed(frames, 23, np.random.default_rng(1), every=10)
    assert (found[::10] == frames[0]).all()
    others = np.delete(found, [0, 10, 20], axis=0)
    assert len(np.unique(others.reshape(20, -1), axis=0)) == 20
    assert not any((frame == frames).all(axis=(1, 2, 3)).any() for frame in others)


def test_the_emulator_carries_nothing_over(tiny_bundle, frames):
    count = 2 * stability.BATCH + 3 * CHUNK
    found = stability.emulate(tiny_bundle.pipeline, frames, count, progress=False)
    assert found["frames"] == count
    assert found["mismatches"] == 0
    assert found["recurrences"] == 4
    assert found["values_compared"] > (4 + 3 * CHUNK) * 16 * 16 * 6


def test_state_that_is_carried_over_is_found(tiny_bundle, frames, monkeypatch):
    """A pipeline that adds one to a depth once it has seen two batches."""
    run, seen = Emulator.run, 0

    def leaky(self, images, **options):
        nonlocal seen
        result = run(self, images, **options)
        seen += len(images)
        if seen <= 2 * stability.BATCH + 1:
            return result
        words = result.depth_words.copy()
        words[:, 3, 3] += 1
        return replace(result, depth_words=words)

    monkeypatch.setattr(Emulator, "run", leaky)
    found = stability.emulate(tiny_bundle.pipeline, frames, 2 * stability.BATCH, progress=False)
    assert found["mismatches"] == stability.BATCH  # the last batch, which is the first one again


@pytest.mark.full
def test_command(tiny_folder, tiny_file, tiny_bundle, tmp_path):
    folder = tmp_path / "tiny"
    shutil.copytree(tiny_folder, folder)
    shutil.copy(tiny_file, folder / "data.h5")
    hardware.write_verilog(tiny_bundle, folder / "verilog", progress=False)
    result = CliRunner().invoke(
        main, ["study", "stability", str(folder), "--frames", "40", "--rtl-frames", "12", "--no-progress"]
    )
    assert result.exit_code == 0, result.output
    content = json.loads((folder / stability.FILE).read_text())
    assert content["emulator"]["mismatches"] == content["rtl"]["mismatches"] == 0
    assert (content["rtl"]["frames"], content["rtl"]["recurrences"]) == (12, 2)
    assert content["rtl"]["values_compared"] == 12 * (14**2 + 16**2 * 3 + 1)
    assert "RTL: 12 frames back to back, the same one 2 times: 0 mismatches" in result.output
