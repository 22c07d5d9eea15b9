import pytest

from fastac.scenes.model_schema import Numbers
from fastac.scenes.schema import SceneError
from fastac.sweep import spec as sweep_spec
from fastac.sweep.spec import SpecError, expand, grid, point_of


@pytest.fixture
def write(tiny_toml, tmp_path):
    (tmp_path / "tiny.toml").write_text(tiny_toml)

    def spec(text: str):
        path = tmp_path / "spec.toml"
        path.write_text('scene = "tiny.toml"\n' + text)
        return path

    return spec


def points(path):
    spec, base = sweep_spec.load(path)
    return list(grid(spec, base, path.parent))


def test_every_point_has_what_is_set(write):
    set_bits = '[set]\n"numbers.data_bits" = 20\n"network.prune" = "unset"\n'
    found = points(write(set_bits + '[axes]\n"poisson.mode" = ["absolute", "difference"]'))
    assert [(p.scene.numbers.data_bits, p.scene.poisson.mode) for p in found] == [
        (20, "absolute"),
        (20, "difference"),
    ]
    assert found[0].axes == {"poisson.mode": "absolute"}
    for text, message in (
        (
            '[set]\n"numbers.colour" = 1\n[axes]\n"numbers.data_bits" = [18]',
            "'numbers.colour': a scene has no",
        ),
        ('[set]\n"numbers.data_bits" = 99\n[axes]\n"poisson.mode" = ["absolute"]', "set: numbers.data_bits"),
        (
            '[set]\n"numbers.data_bits" = 1979-05-27\n[axes]\n"poisson.mode" = ["absolute"]',
            "expected numbers",
        ),
        (set_bits + '[axes]\n"scene" = ["tiny.toml"]', "expected no axis 'scene' beside it"),
    ):
        with pytest.raises(SpecError, match=message) as error:
            points(write(text))
        assert "\n" not in str(error.value)


def test_every_combination_once(write):
    found = points(
        write('[axes]\n"numbers.data_bits" = [18, 26]\n"poisson.mode" = ["absolute", "difference"]')
    )
    values = [(p.scene.numbers.data_bits, p.scene.poisson.mode) for p in found]
    assert values == [(18, "absolute"), (18, "difference"), (26, "absolute"), (26, "difference")]
    assert found[0].axes == {"numbers.data_bits": 18, "poisson.mode": "absolute"}


def test_rounding_is_an_axis(write):
    found = points(write('[axes]\n"numbers.rounding" = ["nearest", "floor", "up"]'))
    assert [p.scene and p.scene.numbers.rounding for p in found] == ["nearest", "floor", None]
    assert found[2].error == "numbers.rounding = 'up': Input should be 'nearest' or 'floor'"


def test_grids_are_put_together(write):
    bits = '[[axes]]\n"numbers.data_bits" = [18, 26]\n'
    assert len(points(write(bits + '[[axes]]\n"numbers.kernel_bits" = [6, 8]\n'))) == 3  # both have the base


def test_keys_that_move_together(write):
    path = write(
        '[axes]\n"numbers.weight_bits, numbers.activation_bits" = [8, 4]\n'
        '"training.finetune_epochs, training.finetune_weights" = [[0, false], [3, true]]'
    )
    found = [(p.scene.numbers, p.scene.training) for p in points(path)]
    assert [(n.weight_bits, n.activation_bits) for n, _ in found] == [(8, 8), (8, 8), (4, 4), (4, 4)]
    assert [(t.finetune_epochs, t.finetune_weights) for _, t in found] == [(0, False), (3, True)] * 2


def test_an_unset_key_has_its_default(write):
    path = write(
        '[[axes]]\n"numbers.kernel_bits" = [6]\n"protocol.tangential_shares, numbers.data_bits" ='
        ' [["unset", "unset"], ["unset", 18]]'
    )
    default = Numbers()
    found = [(p.scene.protocol.tangential_shares, p.scene.numbers.data_bits) for p in points(path)]
    assert found == [(None, default.data_bits), (None, 18)]
    [point] = points(write('[axes]\n"outputs" = ["unset"]'))
    assert point.error == "outputs: missing"


def test_a_list_may_be_one_value(write):
    [point] = points(write('[axes]\n"outputs" = [["normals", "depth"]]'))
    assert point.scene.outputs == ("normals", "depth")
    assert expand("outputs", ["depth"]) == {"outputs": ["depth"]}
    found = points(write('[axes]\n"network.width" = [16, [16, 13, 10]]\n"network.prune" = ["unset", 0.01]'))
    assert [p.scene.network.hidden for p in found] == [(16, 16, 16)] * 2 + [(16, 13, 10)] * 2
    assert [p.scene.network.prune for p in found] == [None, 0.01] * 2


def test_what_cannot_be_is_a_point_with_the_reason(write):
    found = points(write('[axes]\n"poisson.solver" = ["adjoint", "dst2d"]\n"numbers.data_bits" = [99]'))
    assert [p.scene for p in found] == [None, None]
    assert found[1].error.startswith("numbers.data_bits = 99: ")
    assert found[0].content != found[1].content


def test_another_scene(write, tiny_toml, tmp_path):
    (tmp_path / "other.toml").write_text(tiny_toml.replace('mode = "absolute"', 'mode = "difference"'))
    found = points(write('[axes]\nscene = ["tiny.toml", "other.toml"]\n"numbers.data_bits" = [20]'))
    assert [p.scene.poisson.mode for p in found] == ["absolute", "difference"]
    assert {p.scene.numbers.data_bits for p in found} == {20}


def test_the_name_of_a_scene_does_not_count(tiny_scene, tmp_path):
    renamed = tiny_scene.model_copy(update={"name": "other"})
    assert point_of(renamed, {}, tmp_path).content == point_of(tiny_scene, {}, tmp_path).content


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[axes]\n"numbers.bits" = [1]', "axes: 'numbers.bits': a scene has no such key"),
        ('[axes]\n"numbers" = [1]\n"name" = ["x"]', "axes: 'name': a scene has no such key"),
        ('[axes]\n"outputs.depth" = [1]', "axes: 'outputs.depth': a scene has no such key"),
        ('[axes]\n"numbers.data_bits" = []', "axes.0.numbers.data_bits = []: "),
        ("frames = 3", "axes: missing"),
        ('[axes]\n"network.width" = 8', "axes.0.network.width = 8: "),
        ('axis = 3\n[axes]\n"network.width" = [8]', "axis: unknown key"),
        (
            '[axes]\n"numbers.weight_bits, numbers.activation_bits" = [[8, 8, 8]]',
            "axes: 'numbers.weight_bits, numbers.activation_bits': [8, 8, 8]: expected 2 values",
        ),
        (
            'method = "optuna"\n[[axes]]\n"network.width" = [8]\n[[axes]]\n"network.width" = [9]',
            "method = 'optuna': expected one table of axes",
        ),
        ("[axes", ""),
    ],
)
def test_errors_name_file_and_key(write, text, message):
    path = write(text)
    with pytest.raises(SpecError) as caught:
        sweep_spec.load(path)
    assert str(caught.value).startswith(f"{path}: {message}")
    assert "\n" not in str(caught.value)


def test_no_file_and_no_scene(write, tmp_path):
    with pytest.raises(SpecError, match=r"nowhere\.toml: No such file"):
        sweep_spec.load(tmp_path / "nowhere.toml")
    path = write('[axes]\n"network.width" = [8]')
    (tmp_path / "tiny.toml").unlink()
    with pytest.raises(SceneError, match=r"tiny\.toml: No such file"):
        sweep_spec.load(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[axes]\nscene = [3]", "axes: 'scene': 3: expected the name of a scene's file"),
        ('[axes]\nscene = ["a\\u0000b"]', "axes: 'scene': 'a\\x00b': expected the name of a scene's file"),
        ('[axes]\n"scene, numbers.data_bits" = [[["x"], 3]]', "expected the name of a scene's file"),
        ('[axes]\n"numbers.data_bits" = [1979-05-27]', "expected numbers, texts or lists of them"),
        ("[axes]\n'numbers.data_bits' = [0x" + "f" * 5000 + "]", "expected numbers, texts or lists of them"),
        ('data = "a\\nb"\n[axes]\nx = [1]', "data = 'a\\nb': String should match pattern"),
        ("x = " + "[" * 3000, "nested too deeply"),
    ],
)
def test_values_that_no_scene_has(write, text, message):
    path = write(text)
    with pytest.raises(SpecError) as caught:
        sweep_spec.load(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_base_scene_and_a_value_at_a_time(write, tiny_toml, tmp_path):
    (tmp_path / "other.toml").write_text(tiny_toml.replace("tiny", "other"))
    found = points(write('[axes]\n"scene, numbers.data_bits" = [["tiny.toml", 18], ["other.toml", 22]]'))
    assert [p.scene.numbers.data_bits for p in found] == [18, 22]
