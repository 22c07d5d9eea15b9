from pathlib import Path

import pytest

from fastac.scenes.schema import SceneError, load, parse

SCENES = Path(__file__).parents[2] / "scenes"
MINIMAL = 'name = "x"\noutputs = ["depth"]\n[sensor]\ngeometry = "flat"\n'


def error(text: str) -> str:
    """The error of a scene's text: one line, starting with its file."""
    with pytest.raises(SceneError) as caught:
        parse(text, origin="some/scene.toml")
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith("some/scene.toml: ")
    return message.removeprefix("some/scene.toml: ")


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.toml")), ids=lambda path: path.stem)
def test_shipped_scenes_load_and_are_named_after_their_file(path):
    scene = load(path)
    assert scene.name == path.stem
    assert scene.wants_solver or scene.force_from_slopes


def test_what_the_shipped_scenes_say():
    paper, gelsight = load(SCENES / "paper.toml"), load(SCENES / "gelsight.toml")
    assert paper.sensor.channel_names == ("B", "G", "R", "NIR")
    assert paper.wants_force
    assert paper.inner_px == 126
    assert gelsight.sensor.channel_names == ("B", "G", "R")
    assert gelsight.sensor.source == "recorded"
    assert not gelsight.wants_force
    rig = load(SCENES / "fingertip.toml")
    assert (rig.sensor.frames, rig.sensor.elastomer.mechanics) == ("raw10", "fem")
    assert (rig.tangential_shares, paper.tangential_shares) == ((0.3, 0.6), ())
    assert (rig.wants_dots, rig.wants_bridge, rig.wants_darkness) == (True, True, True)
    assert (rig.force_of_weights, rig.force.band_mm, rig.wants_solver) == (True, 0.01, True)
    shear = load(SCENES / "shear.toml")
    assert (shear.wants_dots, shear.wants_bridge, shear.wants_darkness) == (True, True, True)
    assert (shear.force_from_slopes, shear.wants_solver, shear.force_of_weights) == (True, False, False)
    for other in (paper, gelsight, load(SCENES / "force.toml")):
        assert (other.wants_dots, other.wants_bridge, other.wants_darkness) == (False, False, False)
        assert (other.force_of_weights, other.force.band_mm) == (False, None)
    for name in ("fast", "kria"):
        known = load(SCENES / f"{name}.toml")
        assert (known.force.fit, known.force.block_px) == ("polynomials", 4)
        assert known.force.bends_mm == (0.03125, 0.125, 0.25, 0.5)
    fast, small = load(SCENES / "fast.toml"), load(SCENES / "small.toml")
    assert (fast.protocol.train_grid, fast.training.normals_share) == (16, 0.25)  # 768 presses, pixels of 192
    assert (small.force_from_slopes, small.force.block_px, small.numbers.slope_weight_bits) == (True, 4, 16)
    assert paper.sensor.elastomer.mechanics == "layer"
    assert paper.sensor.frames == "channels"


@pytest.mark.parametrize(
    ("outputs", "solver", "force"),
    [
        ('["normals"]', False, False),
        ('["depth"]', True, False),
        ('["force_z"]', True, True),
        ('["normals", "depth", "force_z"]', True, True),
    ],
)
def test_what_the_outputs_need(outputs, solver, force):
    scene = parse(MINIMAL.replace('["depth"]', outputs), origin="x")
    assert (scene.wants_solver, scene.wants_force) == (solver, force)


def test_a_scene_is_named_by_itself_or_by_its_file(tmp_path):
    (tmp_path / "flat-gel_2.toml").write_text(MINIMAL.split("\n", 1)[1])
    assert load(tmp_path / "flat-gel_2.toml").name == "flat-gel_2"
    (tmp_path / "other.toml").write_text(MINIMAL)
    assert load(tmp_path / "other.toml").name == "x"


def test_scenes_cannot_be_changed_and_survive_json():
    scene = parse(MINIMAL, origin="x")
    with pytest.raises(ValueError, match="frozen"):
        scene.name = "y"
    assert type(scene).model_validate(scene.model_dump(mode="json")) == scene


SENSOR = "[sensor]\ngeometry = "


@pytest.mark.parametrize(
    ("text", "message"),
    [
        # unknown keys
        (MINIMAL.replace('name = "x"', 'name = "x"\ncolour = "red"'), "colour: unknown key"),
        (MINIMAL + "height = 3", "sensor.height: unknown key"),
        (MINIMAL + "[sensor.light]\npower = 1", "sensor.light.power: unknown key"),
        (MINIMAL + "[hardware]\nlanes = 2", "hardware.lanes: unknown key"),
        # misspelt: the unknown key comes before the one that is missing for it
        (MINIMAL.replace("geometry", "geometri"), "sensor.geometri: unknown key; did you mean geometry?"),
        (MINIMAL.replace("outputs", "output"), "output: unknown key; did you mean outputs?"),
        (MINIMAL + "[poisson]\nsolvers = 'dst2d'", "poisson.solvers: unknown key; did you mean solver?"),
        (
            MINIMAL + "[sensor.markers]\nradius = 1",
            "sensor.markers.radius: unknown key; did you mean radius_mm?",
        ),
        (
            MINIMAL + "[protocol]\ncorners = 1\nloads_n = 2",
            "protocol.corners: unknown key; did you mean corners_mm?",
        ),
        (
            MINIMAL + "[protocol]\nloads_per_position = 4",
            "protocol = {'loads_per_position': 4}: loads_per_position: 4: expected at most the 3 of loads_n",
        ),
        # wrong types, out of range
        (
            MINIMAL + "[poisson]\nsolver = 'fft'",
            "poisson.solver = 'fft': Input should be 'dst2d', 'tridiagonal' or",
        ),
        (MINIMAL + 'pitch_mm = "thin"', "sensor.pitch_mm = 'thin': Input should be a valid number"),
        (MINIMAL + "pitch_mm = 0", "sensor.pitch_mm = 0: Input should be greater than 0"),
        (MINIMAL + "pitch_mm = inf", "sensor.pitch_mm = inf: Input should be a finite number"),
        (MINIMAL + "height_px = 16.5", "sensor.height_px = 16.5: Input should be a valid integer"),
        (MINIMAL + "height_px = 15", "sensor.height_px = 15: Input should be greater than or equal to 16"),
        (MINIMAL + "width_px = 257", "sensor.width_px = 257: Input should be less than or equal to 256"),
        (MINIMAL + 'channels = "rgb"', "sensor.channels = 'rgb': Input should be 'bgr' or 'bgr+nir'"),
        (MINIMAL + "[numbers]\nslope_limit = 3", "numbers.slope_limit = 3: Input should be 1, 2, 4 or 8"),
        (
            MINIMAL + '[numbers]\nrounding = "up"',
            "numbers.rounding = 'up': Input should be 'nearest' or 'floor'",
        ),
        (MINIMAL + "[numbers]\nweight_bits = 9", "numbers.weight_bits = 9: Input should be less than"),
        (MINIMAL + "[force]\nkernel_size = 4", "force.kernel_size = 4: Input should be 1, 3, 5 or 7"),
        (MINIMAL + "[simulation]\nframes = 1", "simulation.frames = 1: Input should be greater than"),
        (MINIMAL + "[protocol]\nloads_n = []", "protocol.loads_n = []: Tuple should have at least 1 item"),
        (
            MINIMAL + "[protocol]\nloads_n = [1, -2]",
            "protocol.loads_n.1 = -2: Input should be greater than 0",
        ),
        (MINIMAL.replace('["depth"]', "[]"), "outputs = []: Tuple should have at least 1 item"),
        (MINIMAL.replace('["depth"]', '["height"]'), "outputs.0 = 'height': Input should be 'normals'"),
        (MINIMAL.replace('["depth"]', '"depth"'), "outputs = 'depth': Input should be a valid tuple"),
        ('outputs = ["depth"]\n' + SENSOR + '"flat"', "name: missing"),
        ('name = "x"\noutputs = ["depth"]', "sensor: missing"),
        ('name = "x"\noutputs = ["depth"]\n[sensor]', "sensor.geometry: missing"),
        # names
        (MINIMAL.replace('"x"', '"Paper"'), "name = 'Paper': String should match pattern"),
        (MINIMAL.replace('"x"', '"../x"'), "name = '../x': String should match pattern"),
        (MINIMAL.replace('"x"', '""'), "name = '': String should match pattern"),
        (MINIMAL.replace('"x"', '"x\\n"'), "name = 'x\\n': String should match pattern"),
        # impossible combinations
        (MINIMAL.replace('["depth"]', '["depth", "depth"]'), "outputs: named twice"),
        (
            MINIMAL.replace('["depth"]', '["normals"]') + "width_px = 30\n[hardware]\npixels_per_clock = 4",
            "hardware.pixels_per_clock: 4 does not divide sensor.width_px 30",
        ),
        (
            MINIMAL + "height_px = 64",
            "sensor.height_px: 64 differs from width_px 128; the DST engine shares one matrix between rows"
            " and columns, so depth needs square images",
        ),
        (
            MINIMAL.replace("flat", "fingertip") + "[sensor.ellipsoid]\nsemi_axes_mm = [8, 14, 9]",
            "sensor.ellipsoid.semi_axes_mm: 8.0 x 14.0 do not span the image (16 x 16 mm)",
        ),
        (
            MINIMAL.replace("flat", "fingertip") + "pitch_mm = 1e300",
            "sensor.ellipsoid.semi_axes_mm: ",
        ),
        (
            MINIMAL.replace('["depth"]', '["force_xyz", "force_z"]'),
            "outputs: force_xyz has all three axes; name none beside it",
        ),
        (
            MINIMAL.replace('["depth"]', '["depth", "force_map"]'),
            "outputs: force_map needs a force beside it",
        ),
        (
            MINIMAL.replace('["depth"]', '["force_z", "force_map"]') + '[force]\nkernel = "collapsed"',
            "outputs: force_map needs a force beside it, force.kernel 'patch'",
        ),
        (MINIMAL + '[poisson]\nsolver = "adjoint"', "poisson.solver: 'adjoint' finds no depth"),
        (
            MINIMAL.replace("depth", "force_z") + '[poisson]\nsolver = "adjoint"',
            "force.clamp: the adjoint is linear and cannot clamp",
        ),
        (
            MINIMAL.replace("depth", "force_z") + '[force]\nfit = "slopes"',
            "force.fit: 'slopes' needs force.source 'slopes' or poisson.solver 'adjoint'",
        ),
        (
            MINIMAL.replace("depth", "force_z")
            + '[force]\nsource = "displacement"\nclamp = false\n[poisson]\nsolver = "adjoint"',
            "force.source: 'displacement' needs a poisson.solver with depth",
        ),
        (MINIMAL + '[force]\nsource = "slopes"', "force.source: 'slopes' needs a force among outputs"),
        (
            MINIMAL.replace("depth", "force_z") + '[force]\nsource = "slopes"\nclamp = false',
            "force.source: 'slopes' without output depth needs poisson.solver 'adjoint'",
        ),
        (
            MINIMAL.replace('["depth"]', '["depth", "force_z"]') + '[force]\nsource = "slopes"',
            "force.clamp: a force of slopes is linear and cannot clamp",
        ),
        (
            MINIMAL.replace('["depth"]', '["depth", "force_z", "force_map"]')
            + '[force]\nsource = "slopes"\nclamp = false',
            "outputs: force_map needs a force beside it, force.kernel 'patch', and a poisson.solver with"
            " depth, and not force.source 'slopes'",
        ),
        (
            MINIMAL.replace('["depth"]', '["depth", "force_z"]')
            + '[force]\nsource = "slopes"\nclamp = false\nkernel = "collapsed"\nfit = "weights"',
            "force.fit: 'weights' needs force.kernel 'collapsed' and a poisson.solver with depth, and not",
        ),
        (
            MINIMAL + "height_px = 16\nwidth_px = 16\n"
            '[poisson]\nsolver = "tridiagonal"\n[hardware]\npixels_per_clock = 4',
            "poisson.solver: 'tridiagonal' needs rows of 5 beats or more; 14 values at 4 pixels_per_clock",
        ),
        (
            MINIMAL + "[sensor.elastomer]\nfriction = 0.5",
            "sensor.elastomer = {'friction': 0.5}: friction: 0.5 needs mechanics 'fem'",
        ),
        (
            MINIMAL + "[protocol]\ntangential_shares = [0.3]",
            "protocol.tangential_shares: only friction carries them",
        ),
        (MINIMAL + "raw10 = { alpha = 0.5 }", "sensor = {"),
        (
            MINIMAL + 'frames = "raw10"\nraw10 = { beta = 0.5 }',
            "sensor.raw10.beta = 0.5: Input should be greater than or equal to 1",
        ),
        (MINIMAL + 'frames = "raw12"', "sensor.frames = 'raw12': Input should be 'channels' or 'raw10'"),
        (MINIMAL + "[protocol]\ncorners_mm = [[1, 2]]", "protocol.corners_mm.1: missing"),
        # not TOML
        ("outputs = [", "Invalid value (at end of document)"),
        ('name = "x"\nname = "y"', "Cannot overwrite a value"),
    ],
)
def test_errors_name_the_key_in_one_line(text, message):
    assert error(text).startswith(message)


def replaced(text: str, changes: dict[str, str]) -> str:
    """The text with each key of `changes`, which must be in it, replaced by its value."""
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    return text


DOTTED = """name = "x"
outputs = ["depth", "force_z"]
[sensor]
geometry = "flat"
markers = { spacing_mm = 1.6, radius_mm = 0.3 }
[network]
bridge_dots = true
[force]
dots = true
kernel = "collapsed"
clamp = false
fit = "weights"
band_mm = 0.004
"""


@pytest.mark.parametrize(
    ("changes", "dots", "bridge"),
    [
        ({}, True, True),
        ({"[network]\nbridge_dots = true": ""}, True, False),
        ({"dots = true\nkernel": "kernel"}, False, True),
        ({"[network]\nbridge_dots = true": "", "dots = true\nkernel": "kernel"}, False, False),
    ],
)
def test_what_dots_are_wanted_for(changes, dots, bridge):
    scene = parse(replaced(DOTTED, changes), origin="x")
    assert (scene.wants_dots, scene.wants_bridge, scene.wants_darkness) == (dots, bridge, dots or bridge)
    assert scene.force_of_weights
    assert scene.numbers.dot_weight_bits == 16


def test_slip_is_wanted_where_it_is_an_output():
    assert not parse(DOTTED, origin="x").wants_slip
    scene = parse(DOTTED.replace('"force_z"]', '"force_z", "slip"]'), origin="x")
    assert (scene.wants_slip, scene.wants_dots, scene.wants_solver) == (True, True, True)
    assert (scene.slip.contact_mm, scene.slip.limit_px) == (0.06, 0.3)
    scene = parse(DOTTED + "[slip]\ncontact_mm = 0.02\nlimit_px = 1.5\n", origin="x")
    assert (scene.slip.contact_mm, scene.slip.limit_px) == (0.02, 1.5)
    assert not scene.wants_slip, "the table alone asks for nothing"


def test_not_square_is_fine_without_depth():
    scene = parse(MINIMAL.replace("depth", "normals") + "height_px = 64", origin="x")
    assert (scene.sensor.height_px, scene.sensor.width_px) == (64, 128)


def test_a_rectangle_of_lanes_is_fine_where_it_divides():
    for lanes in (1, 2, 4):
        scene = parse(MINIMAL + f"[hardware]\npixels_per_clock = {lanes}", origin="x")
        assert scene.hardware.pixels_per_clock == lanes


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: None, "No such file or directory"),
        (lambda path: path.mkdir(), "Is a directory"),
        (lambda path: path.write_bytes(b"\xff\xfe\x00"), "'utf-8' codec can't decode"),
        (lambda path: path.write_text("name ="), "Invalid value"),
        (lambda path: path.write_text(MINIMAL + "depth = 1"), "sensor.depth: unknown key"),
    ],
)
def test_files_that_cannot_be_used(tmp_path, make, message):
    path = tmp_path / "broken.toml"
    make(path)
    with pytest.raises(SceneError) as caught:
        load(path)
    assert str(caught.value).startswith(f"{path}: {message}")
    assert "\n" not in str(caught.value)


def test_a_file_whose_name_is_no_name_says_so(tmp_path):
    path = tmp_path / "My Scene.toml"
    path.write_text(MINIMAL.split("\n", 1)[1])
    with pytest.raises(SceneError, match="name = 'My Scene': String should match pattern"):
        load(path)


@pytest.mark.parametrize("text", ["x = " + "[" * 3000, "x = " + "{a=" * 3000, "a." * 3000 + "b = 1"])
def test_what_is_nested_too_deeply(text):
    assert error(MINIMAL + text)


@pytest.mark.parametrize("value", ["0x" + "f" * 5000, "9" * 4000, '"' + "X" * 5000 + '"'])
def test_long_values_are_shortened(value):
    found = error(f"name = {value}\n" + MINIMAL.partition("\n")[2])
    assert found.startswith("name = ")
    assert len(found) < 400
