import numpy as np
import pytest
from click.testing import CliRunner

from fastac.cli.main import main
from fastac.models.random_bundle import random_bundle, scene
from fastac.sensor.dataset import Dataset
from fastac.studies.depth.peaks import CHANNELS, RECORDED, lights, measured

SIZE = 12
LOADS_N = (0.5, 1.0)


@pytest.fixture
def pressed():
    """Four presses with the smaller and the larger load in turn, of a skin that is 2 mm high at rest."""
    depth = np.full((4, SIZE, SIZE), 2.0, np.float32)
    depth[:, 5, 6] -= [0.1, 0.2, 0.3, 0.4]
    images = np.full((4, SIZE, SIZE, 4), 100, np.uint8)
    return Dataset(
        frames=images,
        background=images[0],
        split=np.full(4, "test"),
        depth_mm=depth,
        rest_depth_mm=np.full((SIZE, SIZE), 2.0, np.float32),
        pitch_mm=0.1,
        channels=("B", "G", "R", "NIR"),
        source="simulated",
    )


def test_exact_depths_are_off_by_nothing(pressed):
    for row in measured(pressed.depth_mm, pressed.rest_depth_mm, pressed, LOADS_N):
        assert row.largest_percent == pytest.approx(0, abs=1e-4)
        assert row.depth_um == 0


def test_each_load_has_its_own_errors(pressed):
    resting = pressed.rest_depth_mm + 0.5  # what is found at rest is taken away from what is found pressed
    found = resting + (pressed.depth_mm - 2) * np.array([0.9, 1.2, 0.8, 1.0])[:, None, None]
    light, heavy = measured(found, resting, pressed, LOADS_N)
    assert (light.load_n, heavy.load_n) == LOADS_N
    assert light.largest_percent == pytest.approx(-15, abs=1e-3)
    assert heavy.largest_percent == pytest.approx(10, abs=1e-3)
    assert heavy.depth_um == pytest.approx(500 - (0.04 / 2) * 1e3 / (SIZE - 2) ** 2, rel=1e-4)


def test_a_border_is_no_part_of_a_press(pressed):
    found = pressed.depth_mm.copy()
    found[:, 0] = -10
    assert measured(found, pressed.rest_depth_mm, pressed, LOADS_N)[0].depth_um == 0


def test_lights(pressed):
    found = lights(pressed.frames)
    assert list(found) == [RECORDED, "brighter by 1%", "brighter by 3%", "each channel by 1%"]
    assert found[RECORDED] is pressed.frames
    assert (found["brighter by 1%"] == 101).all()
    assert (found["brighter by 3%"] == 103).all()
    gains = lights(np.full((500, 2, 2, 4), 200, np.uint8))["each channel by 1%"]
    assert (gains == gains[:, :1, :1]).all()
    assert gains.std() == pytest.approx(200 * CHANNELS, rel=0.1)


def test_the_command(folder, tmp_path):
    found = CliRunner().invoke(
        main, ["study", "peaks", str(folder), "--ball", "1.2", "--store", str(tmp_path / "store")]
    )
    assert found.exit_code == 0, found.output
    first, head, *rows = found.output.splitlines()
    assert first.startswith(f"{folder}: bundle ")
    assert "N, %  " in head
    columns = 2 * head.count("N, µm")
    light = [" ".join(row.split()[1:-columns]) for row in rows]
    assert light == [*lights(np.zeros((1, 1, 1, 4), np.uint8)), RECORDED]
    assert [float(row.split()[0]) for row in rows] == [1.5] * 4 + [1.2]
    errors = [tuple(map(float, row.split()[-columns:])) for row in rows]
    assert len(set(errors)) == len(rows)  # each light and each ball has its own


def test_bundles_that_cannot_be_compared(tmp_path):
    random_bundle(tmp_path / "bundle", scene(("force_z",), solver="adjoint"))
    found = CliRunner().invoke(main, ["study", "peaks", str(tmp_path)])
    assert found.exit_code == 1
    assert "outputs: force_z find no depth" in found.output
    assert found.output.count("\n") == 1
