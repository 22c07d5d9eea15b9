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


BY_FORCE = """name = "x"
outputs = ["force_z"]
poisson.solver = "adjoint"
force = { clamp = false, fit = "slopes" }
training = { labels = "force" }
sensor = { geometry = "flat", source = "recorded" }
"""


def test_forces_alone_train_a_flat_recorded_sensor():
    assert parse(BY_FORCE, origin="x").force_from_slopes


@pytest.mark.parametrize(
    ("given", "expected"), [("", 0.01), (", light_noise = 0", 0), (", light_noise = 0.03", 0.03)]
)
def test_light_differs_by_a_hundredth_where_the_scene_does_not_say(given, expected):
    text = BY_FORCE.replace('"force" }', f'"force"{given} }}')
    assert parse(text, origin="x").training.force_light_noise == expected


def test_presses_are_moved_where_forces_alone_train():
    texts = BY_FORCE, BY_FORCE.replace('"force" }', '"force", press_reach = 0.1 }')
    assert [parse(text, origin="x").training.force_reach for text in texts] == [0.05, 0.1]
    geometry = parse(BY_FORCE.replace('training = { labels = "force" }', ""), origin="x")
    assert geometry.training.force_reach == 0


def test_the_curl_of_slopes_counts_where_forces_alone_train():
    texts = BY_FORCE, BY_FORCE.replace('"force" }', '"force", curl_weight = 0.3 }')
    assert [parse(text, origin="x").training.force_curl_weight for text in texts] == [1, 0.3]
    geometry = parse(BY_FORCE.replace('training = { labels = "force" }', ""), origin="x")
    assert geometry.training.force_curl_weight == 0


def test_presses_may_be_symmetric_where_forces_alone_train():
    texts = BY_FORCE, BY_FORCE.replace('"force" }', '"force", press_symmetry = false }')
    assert [parse(text, origin="x").training.force_symmetry for text in texts] == [True, False]
    geometry = parse(BY_FORCE.replace('training = { labels = "force" }', ""), origin="x")
    assert not geometry.training.force_symmetry


def test_light_is_the_same_in_all_frames_where_normals_train():
    text = BY_FORCE.replace('training = { labels = "force" }', "")
    assert parse(text, origin="x").training.force_light_noise == 0


def test_the_search_for_a_size_of_weights_is_cut_short_where_forces_alone_train():
    texts = BY_FORCE, BY_FORCE.replace('training = { labels = "force" }', "")
    of_force, of_geometry = (parse(text, origin="x").training for text in texts)
    assert of_force.patience_sizes == 3
    assert of_geometry.patience_sizes is None
    assert of_geometry.model_copy(update={"patience_epochs": 5}).patience_sizes == 5


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('["force_z"]', '["force_z", "normals"]', "training.labels: 'force' gives forces only, no normals"),
        ('["force_z"]', '["normals"]', "training.labels: 'force' gives forces only, no normals"),
        (', fit = "slopes"', "", "training.labels: 'force' gives forces only, no normals"),
        ('"force" }', '"force", teachers = 4 }', "training.teachers: 4 needs training.labels 'geometry'"),
        (
            '"force" }',
            '"force", flat_fraction = 0.2 }',
            "training.flat_fraction: 0.2 needs training.labels 'geometry'",
        ),
        (
            '"force" }',
            '"force", flat_beyond = 3.0 }',
            "training.flat_beyond: 3.0 needs training.labels 'geometry'",
        ),
        (
            '"force" }',
            '"force", position_noise = 0.1 }',
            "training.position_noise: 0.1 needs training.labels 'geometry'",
        ),
        (
            '"force" }',
            '"force", still_share = 0.1 }',
            "training.still_share: 0.1 needs training.labels 'geometry'",
        ),
        (
            "sensor =",
            "network.train_width = 20\nsensor =",
            "network.train_width: needs training.labels 'geometry'",
        ),
        (
            'labels = "force"',
            "light_noise = 0.02",
            "training.light_noise: 0.02 needs training.labels 'force'",
        ),
        (
            'labels = "force"',
            "curl_weight = 0.5",
            "training.curl_weight: 0.5 needs training.labels 'force'",
        ),
        (
            'labels = "force"',
            "press_reach = 0.1",
            "training.press_reach: 0.1 needs training.labels 'force'",
        ),
        (
            'labels = "force"',
            "press_symmetry = true",
            "training.press_symmetry: true needs training.labels 'force'",
        ),
    ],
)
def test_forces_alone_train_nothing_else(old, new, message):
    assert old in BY_FORCE
    assert error(BY_FORCE.replace(old, new)).startswith(message)


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
    text = DOTTED
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    scene = parse(text, origin="x")
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


MARKERS = "markers = { spacing_mm = 1.6, radius_mm = 0.3 }\n"
SLIP = {'"force_z"]': '"force_z", "slip"]'}
NO_BRIDGE = "[network]\nbridge_dots = false"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({MARKERS: ""}, "force.dots: True needs dots on the skin, a table sensor.markers"),
        (
            {MARKERS: "", "dots = true\nkernel": "kernel"},
            "network.bridge_dots: True needs dots on the skin, a table sensor.markers",
        ),
        ({MARKERS: MARKERS + "height_px = 66\n"}, "sensor.height_px: 66: force.dots needs a multiple of 4"),
        ({MARKERS: MARKERS + "width_px = 90\n"}, "sensor.width_px: 90: force.dots needs a multiple of 4"),
        (
            {MARKERS: MARKERS + "height_px = 90\n", "dots = true\nkernel": "kernel"},
            "sensor.height_px: 90: network.bridge_dots needs a multiple of 4",
        ),
        (
            {'["depth", "force_z"]': '["normals"]'},
            "network.bridge_dots: True needs an output that follows from slopes",
        ),
        (
            {'["depth", "force_z"]': '["depth"]', "[network]\nbridge_dots = true": NO_BRIDGE},
            "force.dots: True needs a force among outputs",
        ),
        (
            {'"force_z"]': '"force_z", "force_map"]'},
            "force.dots: True: dots' shifts belong to no pixel; leave out output force_map",
        ),
        (
            {'kernel = "collapsed"': 'kernel = "patch"'},
            "force.fit: 'weights' needs force.kernel 'collapsed' and a poisson.solver with depth",
        ),
        (
            {'["depth", "force_z"]': '["force_z"]', "[network]": '[poisson]\nsolver = "adjoint"\n[network]'},
            "force.fit: 'weights' needs force.kernel 'collapsed' and a poisson.solver with depth",
        ),
        ({'fit = "weights"\n': ""}, "force.band_mm: 0.004 needs force.fit 'weights'"),
        (
            {"band_mm = 0.004": "band_mm = 0.004\ndeep_mm = 0.004"},
            "force.deep_mm: 0.004 needs a force.band_mm that is smaller",
        ),
        ({"band_mm = 0.004": "deep_mm = 0.2"}, "force.deep_mm: 0.2 needs a force.band_mm that is smaller"),
        (
            {'["depth", "force_z"]': '["depth", "slip"]', "dots = true\nkernel": "kernel"},
            "outputs: slip needs a force beside it and a poisson.solver with depth",
        ),
        (
            {
                '["depth", "force_z"]': '["force_z", "slip"]',
                "[network]": '[poisson]\nsolver = "adjoint"\n[network]',
            },
            "outputs: slip needs a force beside it and a poisson.solver with depth",
        ),
        (
            SLIP | {"dots = true\nkernel": "kernel"},
            "outputs: slip needs force.dots = true and a force beside it",
        ),
        (
            {"[network]": "[slip]\ncontact_mm = 0\n[network]"},
            "slip.contact_mm = 0: Input should be greater than 0",
        ),
        (
            {"[network]": "[slip]\nlimit_px = -1\n[network]"},
            "slip.limit_px = -1: Input should be greater than 0",
        ),
        ({"band_mm = 0.004": "band_mm = 0"}, "force.band_mm = 0: Input should be greater than 0"),
        ({'fit = "weights"': 'fit = "weight"'}, "force.fit = 'weight': Input should be"),
        ({"dots = true\nkernel": "dots = 2\nkernel"}, "force.dots = 2: Input should be a valid boolean"),
        (
            {"[network]": "[numbers]\ndot_weight_bits = 5\n[network]"},
            "numbers.dot_weight_bits = 5: Input should be greater than or equal to 6",
        ),
    ],
)
def test_dots_and_bands_that_cannot_be_are_named_in_one_line(changes, message):
    text = DOTTED
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    assert error(text).startswith(message)


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


def test_a_network_has_a_width_or_one_for_each_layer():
    text = 'name = "x"\noutputs = ["depth"]\nsensor.geometry = "flat"\n[network]\nwidth = {}'
    assert parse(text.format(12), origin="x").network.hidden == (12, 12, 12)
    assert parse(text.format([16, 13, 10]), origin="x").network.hidden == (16, 13, 10)
    for wrong in ("3", "65", "[16, 13]", "[16, 13, 3]", "true", "8.5", '"16"'):
        with pytest.raises(SceneError) as refusal:
            parse(text.format(wrong), origin="x")
        assert "network.width = " in str(refusal.value)
        assert "expected a number from 4 to 64, or a list of three" in str(refusal.value)


def test_a_network_may_be_trained_wider_than_it_is_wanted():
    text = 'name = "x"\noutputs = ["depth"]\nsensor.geometry = "flat"\n[network]\nwidth = [12, 8, 6]\n{}'
    assert parse(text.format(""), origin="x").network.trained == (12, 8, 6)
    found = parse(text.format("train_width = 16"), origin="x")
    assert (found.network.trained, found.network.hidden) == ((16, 16, 16), (12, 8, 6))
    assert parse(text.format("train_width = [12, 9, 6]"), origin="x").network.trained == (12, 9, 6)
    for wrong, expected in (
        ("[12, 7, 6]", "network.train_width: 7 in hidden layer 2: expected at least the 8 of network.width"),
        ("3", "network.train_width = 3: expected a number from 4 to 64, or a list of three"),
    ):
        with pytest.raises(SceneError) as refusal:
            parse(text.format(f"train_width = {wrong}"), origin="x")
        assert str(refusal.value).startswith(f"x: {expected}")
