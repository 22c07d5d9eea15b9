import pytest

from fastac.sensor.protocol import FingertipError
from fastac.studies.transfer.units import DIFFERENCES, SPECULAR, unit_of


def test_units_differ_within_their_tolerances(tiny_scene):
    units = [unit_of(tiny_scene, number) for number in (1, 2, 3)]
    assert units == [unit_of(tiny_scene, number) for number in (1, 2, 3)]
    for keys in DIFFERENCES.values():
        for key, share in keys.items():
            own = tiny_scene.value_at(key)
            values = [unit.value_at(key) for unit in units]
            assert len({own, *values}) == 4
            assert all(abs(value / own - 1) <= share + 1e-6 for value in values)
    shine = {unit.sensor.light.specular for unit in units}
    assert len(shine) == 3
    assert 0 < max(shine) <= SPECULAR
    assert len({unit.protocol.seed for unit in (tiny_scene, *units)}) == 4
    assert all(unit.training == tiny_scene.training for unit in units)


def test_a_recorded_sensor_has_no_units(make_scene):
    recorded = make_scene(sensor={"source": "recorded"})
    with pytest.raises(FingertipError, match=r"^sensor.source = 'recorded': expected 'simulated'$"):
        unit_of(recorded, 1)
