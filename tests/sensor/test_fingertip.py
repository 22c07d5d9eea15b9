from pathlib import Path

import numpy as np
import pytest

from fastac.scenes.schema import Protocol, parse
from fastac.sensor.dataset import read
from fastac.sensor.fingertip import generate
from fastac.sensor.mechanics.layer import Layer
from fastac.sensor.mechanics.layer_rig import surface
from fastac.sensor.mechanics.press import ContactError
from fastac.sensor.mechanics.random_indenter import indenter_of
from fastac.sensor.protocol import FingertipError, positions_mm


def scene(outputs='["depth", "force_z"]', geometry="fingertip", channels="bgr+nir", protocol="", extra=""):
    text = f"""
    name = "tiny"
    outputs = {outputs}
    [sensor]
    geometry = "{geometry}"
    channels = "{channels}"
    height_px = 32
    width_px = 32
    pitch_mm = 0.5
    {extra}
    [protocol]
    train_grid = 2
    validation_grid = 1
    test_grid = 2
    loads_n = [0.5, 1.0]
    {protocol}
    """
    return parse(text, origin="tiny")


def generated(tmp_path, scene, name="d.h5", processes=1):
    generate(scene, tmp_path / name, progress=False, processes=processes)
    return read(tmp_path / name, scene)


@pytest.mark.parametrize("sizes", [(8, 5, 8), (3, 4, 2), (1, 1, 1), (2, 7, 5)])
def test_no_two_splits_share_a_place(sizes):
    train, validation, test = sizes
    protocol = Protocol(train_grid=train, validation_grid=validation, test_grid=test)
    sensor = scene().sensor
    positions = positions_mm(sensor, protocol)
    everywhere = np.concatenate(list(positions.values()))
    assert [len(grid) for grid in positions.values()] == [train**2, validation**2, test**2]
    distance = np.linalg.norm(everywhere[:, None] - everywhere, axis=-1)
    step = 9.5 / (2 * max(sizes) - 1)
    assert distance[~np.eye(len(everywhere), dtype=bool)].min() > 0.99 * step
    half = 31 * 0.25 - sensor.elastomer.rim_mm - 0.3 * protocol.ball_mm
    assert np.abs(everywhere).max() <= half + 1e-9


def test_paper_s_protocol_presses_away_from_the_rim():
    text = 'name="p"\noutputs=["depth"]\n[sensor]\ngeometry="flat"\n'
    paper = parse(text, origin="p")
    layer = Layer(paper.sensor)
    corners = positions_mm(paper.sensor, paper.protocol)
    for x, y in (corners["train"][0], corners["test"][-1]):
        contact = layer.press(x, y, ball_mm=5.0, load_n=1.5)
        assert layer.modulation[contact.pressure_mpa > 0].min() > 0.75


def test_ground_truth_fits_together(tmp_path):
    small = scene()
    data = generated(tmp_path, small)
    assert len(data) == (4 + 1 + 4) * 2
    assert data.channels == ("B", "G", "R", "NIR")
    assert data.source.startswith("simulated")
    assert [len(data.indices(split)) for split in ("train", "validation", "test")] == [8, 2, 8]
    np.testing.assert_allclose(data.force_n[:, 2], np.tile([0.5, 1.0], len(data) // 2), rtol=1e-6)
    # A ball right of the middle lies on skin that falls to the right, and is pushed that way.
    position = np.stack([data.indenter["x_mm"], data.indenter["y_mm"]], axis=-1)
    aside = np.abs(position) > 0.5
    np.testing.assert_array_equal(np.sign(data.force_n[:, :2])[aside], np.sign(position)[aside])
    assert np.all(np.abs(data.force_n[:, :2]) < data.force_n[:, 2:])
    displacement = data.rest_depth_mm - data.depth_mm
    for edge in (displacement[:, [0, -1]], displacement[:, :, [0, -1]]):
        np.testing.assert_array_equal(edge, 0)
    np.testing.assert_allclose(displacement.max(axis=(1, 2)), data.indenter["approach_mm"], rtol=0.05)
    assert np.all(data.indenter["contact_radius_mm"] < data.indenter["ball_mm"] / 2)
    heavier = data.indenter["approach_mm"].reshape(-1, 2)
    assert np.all(heavier[:, 1] > heavier[:, 0])
    # The frames differ from the background where the skin moved, and only there.
    change = np.abs(data.frames.astype(int) - data.background).max(axis=-1)
    assert change[displacement > 0.2].mean() > 10
    noise = np.sqrt(small.sensor.noise_dn**2 + 255 / small.sensor.electrons_per_dn)
    assert change[:, [0, -1]].max() <= 6 * noise
    assert change[displacement > 0.2].mean() > change[:, [0, -1]].mean() + 3


def test_normals_are_the_slopes_of_the_depth_and_the_ball_s_in_contact():
    fine = scene(extra="").sensor.model_copy(update={"height_px": 160, "width_px": 160, "pitch_mm": 0.1})
    layer = Layer(fine)
    contact = layer.press(0.7, -0.4, ball_mm=5.0, load_n=1.0)
    normals, depth = surface(contact, layer, 0.7, -0.4, 5.0)
    q, p = np.gradient(depth, fine.pitch_mm)
    slopes = -normals[..., :2] / normals[..., 2:]
    error = np.abs(slopes - np.stack([p, q], axis=-1))[1:-1, 1:-1]
    assert error.mean() < 2e-3
    v, u = np.unravel_index(np.argmax(contact.pressure_mpa), depth.shape)
    centre = np.array(
        [0.7, -0.4, np.sqrt(6.25 - (layer.x_mm[v, u] - 0.7) ** 2 - (layer.y_mm[v, u] + 0.4) ** 2)]
    )
    towards = centre - [layer.x_mm[v, u], layer.y_mm[v, u], 0]
    np.testing.assert_allclose(normals[v, u], towards / 2.5, atol=1e-9)


def test_the_number_of_processes_changes_nothing(tmp_path):
    one = generated(tmp_path, scene(), "one.h5")
    two = generated(tmp_path, scene(), "two.h5", processes=2)
    for key in ("frames", "background", "normals", "depth_mm", "force_n"):
        np.testing.assert_array_equal(getattr(one, key), getattr(two, key))


def test_the_seed_decides_the_noise_and_nothing_else(tmp_path):
    one = generated(tmp_path, scene(), "one.h5")
    two = generated(tmp_path, scene(protocol="seed = 2"), "two.h5")
    assert (one.frames != two.frames).any()
    np.testing.assert_array_equal(one.depth_mm, two.depth_mm)


def test_no_depth_where_nothing_solves_for_it(tmp_path):
    data = generated(tmp_path, scene(outputs='["normals"]', channels="bgr", geometry="flat"))
    assert data.channels == ("B", "G", "R")
    assert data.depth_mm is None
    assert data.rest_depth_mm is None
    assert data.normals is not None


def test_refuses_recorded_scenes_and_sensors_too_small(tmp_path):
    recorded = scene(outputs='["depth"]', extra='source = "recorded"')
    with pytest.raises(FingertipError, match=r"sensor\.source = 'recorded': expected 'simulated'"):
        generate(recorded, tmp_path / "d.h5", progress=False)
    with pytest.raises(FingertipError, match=r"protocol\.ball_mm = 30: no room"):
        generate(scene(protocol="ball_mm = 30.0"), tmp_path / "d.h5", progress=False)
    assert list(tmp_path.iterdir()) == []


FEM = """
markers = { spacing_mm = 2.0, radius_mm = 0.5 }
elastomer = { mechanics = "fem", friction = 0.5, elements = 10, layers = 2 }
"""


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """A scene of the finite-element gel, its dataset's file, and the folder of compliances."""
    folder = tmp_path_factory.mktemp("fem")
    small = scene('["depth", "force_xyz"]', extra=FEM)
    generate(small, folder / "d.h5", store=folder / "cache", progress=False, processes=1)
    return small, folder / "d.h5", folder / "cache"


def test_the_finite_element_gel_gives_all_loads_and_counts_what_slides(rig):
    small, path, cache = rig
    data = read(path, small)
    assert data.left_out > 0
    assert len(data) + data.left_out == (4 + 1 + 4) * 2 * 9
    assert len(list(cache.rglob("compliance.npy"))) == 1
    load, target = data.indenter["load_n"], np.stack([data.indenter[f"tangential_{k}_n"] for k in "xy"], -1)
    np.testing.assert_allclose(data.force_n[:, 2], load, rtol=1e-5)
    size = np.linalg.norm(target, axis=1)
    dragged = size > 0
    along = np.einsum("ni,ni->n", data.force_n[:, :2], target)[dragged] / size[dragged]
    np.testing.assert_allclose(along, size[dragged], rtol=1e-4)
    assert set(np.round(size[dragged] / load[dragged], 6)) <= {0.3, 0.6}
    assert (~dragged).sum() == 18, "every vertical sample is there"


def test_finite_element_ground_truth_fits_together(rig):
    small, path, _ = rig
    data = read(path, small)
    sunk = data.rest_depth_mm - data.depth_mm
    np.testing.assert_allclose(sunk[:, [0, -1]], 0, atol=1e-6)
    deepest = sunk.max(axis=(1, 2))
    assert (deepest > 0.1).all()
    assert (deepest < data.indenter["approach_mm"] + 0.3).all()
    moved = data.markers_px - data.markers_px.mean(axis=0)
    assert data.markers_px.shape[1:] == (49, 2)
    assert np.abs(moved).max() > 0.2
    assert data.tangential_mm.shape == (len(data), 32, 32, 2)


@pytest.mark.full
def test_worker_processes_change_nothing_in_finite_elements(rig, tmp_path):
    small, path, cache = rig
    generate(small, tmp_path / "d.h5", store=cache, progress=False, processes=2)
    one, two = read(path), read(tmp_path / "d.h5")
    for key in ("frames", "background", "normals", "depth_mm", "force_n", "markers_px", "tangential_mm"):
        np.testing.assert_array_equal(getattr(one, key), getattr(two, key))


def test_the_shipped_rig_records_raw10_with_dots_and_tangential_loads(tmp_path):
    """scenes/fingertip.toml on a coarse mesh, one place in each grid, one load."""
    text = (Path(__file__).parents[2] / "scenes" / "fingertip.toml").read_text()
    text = text.replace('mechanics = "fem"', 'mechanics = "fem"\nelements = 12\nlayers = 2')
    grids = "train_grid = 1\nvalidation_grid = 1\ntest_grid = 1\nloads_n = [1.0]"
    text = text.replace("[protocol]\n", f"[protocol]\n{grids}\n")
    small = parse(text, origin="fingertip", default_name="fingertip")
    generate(small, tmp_path / "d.h5", store=tmp_path, progress=False, processes=1)
    data = read(tmp_path / "d.h5", small)
    # Further balls in train and validation: five stations of a vertical load and eight drags.
    assert len(data) + data.left_out == 5 * 9
    assert len(np.unique(data.indenter["ball_mm"])) == 2
    assert data.raw10.shape[1:] == data.background.shape == (512, 512)
    assert data.markers_px.shape[1:] == (81, 2)
    change = np.abs(data.raw10.astype(int) - data.background).reshape(len(data), 128, 4, 128, 4)
    touched = np.abs(data.rest_depth_mm - data.depth_mm) > 0.2
    assert change.mean(axis=(2, 4))[touched].mean() > 2 * change[:, 0].mean()


@pytest.mark.parametrize("mechanics", ["layer", "fem"])
def test_a_random_shape_that_the_contact_cannot_carry_is_left_out(mechanics, tmp_path, monkeypatch):
    def drawn(station):
        if station.shape == "punch" and station.split == "train":
            raise ContactError("too much")
        return indenter_of(station)

    for module in ("layer_rig", "fem.rig"):
        monkeypatch.setattr(f"fastac.sensor.mechanics.{module}.indenter_of", drawn)
    gel = f'[sensor.elastomer]\nmechanics = "{mechanics}"\nelements = 12\nlayers = 1'
    with_shapes = scene(extra=gel, protocol='more_shapes = ["punch"]')
    generate(with_shapes, tmp_path / "d.h5", store=tmp_path, progress=False, processes=1)
    data = read(tmp_path / "d.h5", with_shapes)
    assert data.left_out == 4 * 2
    assert data.group.tolist() == [f"ball {k}" for k in range(9) for _ in range(2)] + ["punch 13"] * 2
    assert np.isnan(data.indenter["ball_mm"]).tolist() == [False] * 18 + [True] * 2
    assert (data.indenter["contact_radius_mm"] > 0).all()
    np.testing.assert_allclose(data.force_n[-2:, 2], [0.5, 1.0], rtol=1e-3)
    without = scene(extra=gel)
    generate(without, tmp_path / "balls.h5", store=tmp_path, progress=False, processes=1)
    balls = read(tmp_path / "balls.h5", without)
    assert balls.group is None
    np.testing.assert_array_equal(data.force_n[:18], balls.force_n)


def test_a_vertical_load_beyond_the_gel_is_an_error(rig, tmp_path):
    small, _, cache = rig
    heavy = small.model_copy(update={"protocol": small.protocol.model_copy(update={"loads_n": (40.0,)})})
    with pytest.raises(ContactError, match="with 40 N"):
        generate(heavy, tmp_path / "d.h5", store=cache, progress=False, processes=1)
    assert list(tmp_path.iterdir()) == []
