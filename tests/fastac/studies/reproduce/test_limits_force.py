"""The force experiments on drawn displacements, whose force is known."""

from dataclasses import replace

import numpy as np
import pytest

from fastac.sensor.samples import SPLITS
from fastac.studies.reproduce.limits_force import closed_form, mixed, seen, smaller_loads

COUNTS = {"train": 40, "validation": 10, "test": 10}
N = 14


@pytest.fixture(scope="module")
def drawn():
    """Displacements and forces that are stiffness times volume, stiffer along x, by split."""
    rng, fields, forces = np.random.default_rng(2), {}, {}
    v, u = np.indices((N, N))
    for split, count in COUNTS.items():
        at, size = rng.uniform(4, N - 4, (count, 2)), rng.uniform(0.1, 0.3, (count, 3))
        bump = np.exp(-((u - at[:, :1, None]) ** 2 + (v - at[:, 1:, None]) ** 2) / 10)
        fields[split] = size[..., None, None] * bump[:, None]
        forces[split] = (fields[split] * (1 + u / N)).sum(axis=(2, 3))
    return fields, forces


def test_a_linear_force_is_found_in_closed_form(drawn, make_scene):
    scene = make_scene(outputs=["depth", "force_xyz"], force={"kernel_size": 3, "hidden": 6})
    errors = closed_form(scene, np.zeros((N + 2, N + 2)), drawn)
    assert max(errors["nmae_percent"]) < 1
    again = closed_form(scene, np.zeros((N + 2, N + 2)), drawn)
    assert errors == again


def test_the_clamp_is_the_scene_s(drawn, make_scene):
    """Where the skin bulges as much as it sinks, a clamp hides what the force depends on."""
    fields, forces = drawn
    bulging = {split: field - 0.5 * field.mean(axis=(2, 3), keepdims=True) for split, field in fields.items()}
    shape = {"kernel_size": 3, "hidden": 6}
    keys = {"outputs": ["depth", "force_xyz"]}
    rest = np.zeros((N + 2, N + 2))
    held, free = (
        closed_form(make_scene(**keys, force={**shape, "clamp": clamp}), rest, (bulging, forces))["mae_n"][2]
        for clamp in (True, False)
    )
    assert held > 2 * free


def test_mixtures_take_each_component_from_where_they_say(drawn):
    kept = {split: np.arange(count) % 3 > 0 for split, count in COUNTS.items()}
    true = seen(drawn, kept)
    found = {split: -field for split, field in true[0].items()}, true[1]
    for split in SPLITS:
        np.testing.assert_array_equal(true[0][split], drawn[0][split][kept[split]])
        np.testing.assert_array_equal(true[1][split], drawn[1][split][kept[split]])
        sign = np.array([1, 1, -1])[:, None, None]
        np.testing.assert_array_equal(mixed(true, found)[0][split], sign * true[0][split])
        np.testing.assert_array_equal(mixed(found, true)[0][split], -sign * true[0][split])
        assert mixed(true, found)[1][split] is true[1][split]


def test_smaller_loads_are_all_but_the_largest(drawn, tiny_data):
    split = np.repeat(list(COUNTS), list(COUNTS.values()))
    load = np.tile([0.5, 1.0, 1.5, 1.5], 15)
    data = replace(tiny_data, split=split, indenter={"load_n": load})
    fields, forces = smaller_loads(data, drawn)
    assert len(fields["train"]) == len(forces["train"]) == 20
    np.testing.assert_array_equal(fields["test"], drawn[0]["test"][load[50:] < 1.5])
    assert smaller_loads(replace(data, indenter={"load_n": np.minimum(load, 1.0)}), drawn) is None
    assert smaller_loads(replace(data, indenter=None), drawn) is None
