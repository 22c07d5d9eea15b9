"""Steps side by side in processes, each performed once."""

import pytest

from fastac.sensor.mechanics.fem.compliance import FILE, mesh_digest, write_unit_compliance
from fastac.sensor.mechanics.fem.mesh import sensor_mesh
from fastac.store.side_by_side import perform_all
from fastac.store.steps import Step
from fastac.store.store import open_store


@pytest.mark.parametrize("processes", [1, 2])
def test_each_step_is_performed_once(make_scene, tmp_path, processes):
    mesh = sensor_mesh(make_scene().sensor, elements=6, layers=2)
    digest, unkeyed = mesh_digest(mesh), {"mesh": mesh, "progress": False}
    steps = [
        Step(
            "compliance",
            write_unit_compliance,
            {"nodes_sha256": digest, "poisson_ratio": ratio},
            (FILE,),
            unkeyed,
        )
        for ratio in (0.4, 0.45)
    ]
    store = open_store(tmp_path)
    perform_all(tmp_path, steps, processes, label="compliances", progress=False)
    assert all(store.is_current(step) for step in steps)
    entries = [store.perform(step).id for step in steps]
    assert len(set(entries)) == 2
    perform_all(tmp_path, steps, processes, label="compliances", progress=False)
    assert [store.perform(step).id for step in steps] == entries
