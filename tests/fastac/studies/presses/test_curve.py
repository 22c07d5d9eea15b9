import pytest

from fastac.studies.presses import curve, shown
from fastac.tune.groups import TuneError


def test_errors_over_presses(make_scene, tiny_file, tmp_path):
    scene = make_scene(outputs=["normals", "depth"], training={"normals_epochs": 1, "finetune_epochs": 1})
    settings = {"draws": 2, "jobs": 1, "store": tmp_path / "store"}
    content = curve.measure(scene, tiny_file, tmp_path / "out", counts=[8, 12], **settings)
    assert (tmp_path / "out" / curve.FILE).is_file()
    assert list(content["errors"]) == ["8", "12"]
    each = [shown.values(content, count, "normal_mae_deg") for count in (8, 12)]
    assert len({float(value) for errors in each for value in errors}) == 4, "each choice has a training"
    assert [row[0] for row in shown.table(content).rows] == [8, 12]
    shown.write(content, tmp_path / "presses.png")
    assert (tmp_path / "presses.png").stat().st_size > 1000
    again = curve.measure(scene, tiny_file, tmp_path / "out", counts=[12, 8], **settings)
    assert again["errors"]["8"] == content["errors"]["8"]
    with pytest.raises(TuneError, match=r"--presses 500: .*tiny.* has \d+ presses"):
        curve.measure(scene, tiny_file, tmp_path / "out", counts=[500], **settings)
