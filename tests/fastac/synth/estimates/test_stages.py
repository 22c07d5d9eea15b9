import pytest

from fastac.synth.estimates.stages import stage_of


@pytest.mark.parametrize(
    ("instance", "stage"),
    [
        ("smoothing", "smoothing"),
        ("mlp.fc0_lane1", "normals"),
        ("mlp (own logic)", "normals"),
        ("solver.column_inverse", "transforms"),
        ("solver.source", "source"),
        ("force_stream.patches", "force"),
        ("registers", "control"),
        ("depth_tags", "control"),
        ("top (own logic)", "control"),
    ],
)
def test_stages_by_instance(instance, stage):
    assert stage_of(instance) == stage
