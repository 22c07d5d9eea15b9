from dataclasses import replace

import numpy as np

from fastac.flow import adapt, few_presses
from fastac.models.training import transfer


def test_what_tunes_the_fewest_numbers_of_those_that_are_as_good():
    def errors(**of_presses):
        return {what: dict(enumerate(values)) for what, values in of_presses.items()}

    clear = errors(none=(9, 9, 9), gains=(4, 5, 6), last=(3, 4, 5), all=(1, 2, 3.1))
    assert adapt.simplest(clear) == "all"
    assert adapt.simplest(clear | errors(gains=(1, 2.2, 3))) == "gains"
    assert adapt.simplest(clear | errors(last=(1, 1, 1))) == "last"
    assert adapt.simplest(clear | errors(none=(1, 2.2, 3))) == "none"


def test_presses_are_held_out_whole(tiny_folder, tiny_bundle, tiny_data, tiny_file, tmp_path, monkeypatch):
    """No frame of a press is tuned on where the press is judged, and each press is judged once."""
    taken, press = [], few_presses.presses(tiny_data)

    def pixels_of(data, scene, chosen):
        taken.append(set(press[chosen]))
        return np.zeros((4, 6), int), np.full((4, 3), (0, 0, 1), np.float32)

    monkeypatch.setattr(adapt.transfer, "tune", lambda network, *_, **__: (network, []))
    monkeypatch.setattr(adapt, "pixels_of", pixels_of)
    given = {"scene": tiny_bundle.scene, "bundle": tiny_folder / "bundle", "data": tiny_file}
    found = adapt.choice(tmp_path, **given, store=tmp_path, progress=False)
    assert (found["presses"], found["tune"]) == (13, "none")
    names = set(few_presses.known_presses(tiny_data))
    assert list(found["errors"]) == ["none", *transfer.TUNES]
    assert all(set(errors) == names for errors in found["errors"].values())
    learned, held = None, []
    for presses in taken:
        if len(presses) > 1:
            learned = presses
        else:
            assert not presses & learned
            held += presses
    assert sorted(held) == sorted(names)


def test_limits_are_as_wide_as_those_of_the_first_unit(tiny_bundle):
    known = tiny_bundle.pipeline.validity
    few = replace(known, low=known.low + 1, high=known.high.copy())
    few.high[0] += 1
    found = adapt.as_wide_limits(few, known)
    np.testing.assert_array_equal(found.low, known.low)
    np.testing.assert_array_equal(found.high, few.high)
