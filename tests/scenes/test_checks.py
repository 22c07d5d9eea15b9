import pytest

from fastac.scenes.schema import parse
from tests.scenes.test_schema import DOTTED, error, replaced
from tests.scenes.test_training_schema import BY_FORCE

MARKERS = "markers = { spacing_mm = 1.6, radius_mm = 0.3 }\n"
SLIP = {'"force_z"]': '"force_z", "slip"]'}
NO_BRIDGE = "[network]\nbridge_dots = false"


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
            '"force", huber_delta = 0.1 }',
            "training.huber_delta: 0.1 needs training.labels 'geometry'",
        ),
        (
            '"force" }',
            '"force", depth_weight = 0.5 }',
            "training.depth_weight: 0.5 needs training.labels 'geometry'",
        ),
        (
            '"force" }',
            '"force", rounding_noise = true }',
            "training.rounding_noise: true needs training.labels 'geometry'",
        ),
        (
            '"force" }',
            '"force", weight_rounding_noise = true }',
            "training.weight_rounding_noise: true needs training.labels 'geometry'",
        ),
        (
            '"force" }',
            '"force", initial_weights = "active" }',
            "training.initial_weights: 'active' needs training.labels 'geometry'",
        ),
        (
            '"force" }',
            '"force", force_steps = 5 }',
            "training.force_steps: 5 needs training.labels 'geometry'",
        ),
        (
            '"force" }',
            '"force", normals_share = 0.5 }',
            "training.normals_share: 0.5 needs training.labels 'geometry'",
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
            "press_symmetry = true",
            "training.press_symmetry: true needs training.labels 'force'",
        ),
    ],
)
def test_forces_alone_train_nothing_else(old, new, message):
    assert old in BY_FORCE
    assert error(BY_FORCE.replace(old, new)).startswith(message)


def test_dots_belong_to_their_places():
    text = BY_FORCE.replace('fit = "slopes"', 'fit = "slopes", dots = true')
    text = text.replace('"recorded"', '"recorded", markers = { spacing_mm = 1.6, radius_mm = 0.3 }')
    assert parse(text, origin="x").wants_dots
    message = "training.press_symmetry: true needs force.dots = false"
    assert error(text.replace('"force" }', '"force", press_symmetry = true }')).startswith(message)


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
            {"[network]\n": "[network]\nsmoothing_px = 4\n"},
            "network.smoothing_px: 4 needs network.bridge_dots and force.dots to be false",
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
            {'fit = "weights"': 'fit = "polynomials"', 'kernel = "collapsed"': 'kernel = "patch"'},
            "force.fit: 'polynomials' needs force.kernel 'collapsed' and a poisson.solver with depth",
        ),
        (
            {'["depth", "force_z"]': '["force_z"]', "[network]": '[poisson]\nsolver = "adjoint"\n[network]'},
            "force.fit: 'weights' needs force.kernel 'collapsed' and a poisson.solver with depth",
        ),
        ({'fit = "weights"\n': ""}, "force.band_mm: 0.004 needs force.fit 'weights' or 'polynomials'"),
        (
            {"band_mm = 0.004": "band_mm = 0.004\ndeep_mm = 0.004"},
            "force.deep_mm: 0.004 needs a force.band_mm that is smaller",
        ),
        ({"band_mm = 0.004": "deep_mm = 0.2"}, "force.deep_mm: 0.2 needs a force.band_mm that is smaller"),
        (
            {"band_mm = 0.004": "band_mm = 0.1\ndeep_mm = [0.1, 0.2]"},
            "force.deep_mm: 0.1 needs a force.band_mm that is smaller",
        ),
        (
            {"band_mm = 0.004": "deep_mm = [0.1, 0.2]"},
            "force.deep_mm: 0.1 needs a force.band_mm that is smaller",
        ),
        (
            {'fit = "weights"\nband_mm = 0.004': "block_px = 2"},
            "force.block_px: 2 needs force.fit 'weights' or 'polynomials', or a force of slopes",
        ),
        ({"band_mm = 0.004": "block_px = 3"}, "force.block_px = 3: Input should be 1, 2, 4 or 8"),
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
        *(
            (
                {"band_mm = 0.004": f"band_mm = 0.004\ndeep_mm = {value}"},
                f"force.deep_mm = {value.replace('true', 'True')}: expected a number of mm greater than 0, or"
                " an ascending list of such numbers",
            )
            for value in ("0", "[]", "[0.2, 0.1]", "[0.1, 0.1]", "[0.0, 0.1]", "'deep'", "true", "[inf, inf]")
        ),
        ({'fit = "weights"': 'fit = "weight"'}, "force.fit = 'weight': Input should be"),
        ({"dots = true\nkernel": "dots = 2\nkernel"}, "force.dots = 2: Input should be a valid boolean"),
        (
            {"[network]": "[numbers]\ndot_weight_bits = 5\n[network]"},
            "numbers.dot_weight_bits = 5: Input should be greater than or equal to 6",
        ),
    ],
)
def test_dots_and_bands_that_cannot_be_are_named_in_one_line(changes, message):
    assert error(replaced(DOTTED, changes)).startswith(message)


def test_depth_is_learned_on_square_frames():
    text = 'name = "x"\noutputs = ["normals"]\nsensor = { geometry = "flat", height_px = 64 }\n[training]\n'
    message = "training.depth_weight: 0.5 needs square images, and sensor has 64 x 128 px"
    assert error(text + "depth_weight = 0.5\n") == message


def test_a_force_is_learned_as_a_sum_of_slopes_or_by_kernels():
    start, end = 'name = "x"\noutputs = ["force_z"]\n', "[training]\nforce_weight = 2.0\n"
    flat = '[sensor]\ngeometry = "flat"\n'
    slopes = '[poisson]\nsolver = "adjoint"\n[force]\nclamp = false\nfit = "slopes"\n'
    for way in (slopes, ""):
        assert parse(start + flat + way + end, origin="x").training.force_weight == 2
    message = (
        "training.force_weight: 2.0 needs a force among outputs, force.fit 'slopes' or 'displacement' and"
    )
    weights = '[force]\nkernel = "collapsed"\nfit = "weights"\n'
    assert error(start + flat + weights + end).startswith(message)
    assert error(start.replace("force_z", "depth") + flat + end).startswith(message)
    dots = slopes + "dots = true\n" + "[sensor.markers]\nspacing_mm = 1.6\nradius_mm = 0.3\n"
    assert error(start + flat + dots + end).startswith(message)


def test_the_force_alone_is_learned_where_nothing_needs_the_normals():
    start, end = 'name = "x"\noutputs = ["force_z"]\n', "[training]\nforce_steps = 5\n"
    flat = '[sensor]\ngeometry = "flat"\n'
    slopes = '[poisson]\nsolver = "adjoint"\n[force]\nclamp = false\nfit = "slopes"\n'
    scene = parse(start + flat + slopes + end, origin="x")
    assert (scene.training.force_steps, scene.learns_force_of_slopes) == (5, True)
    message = "training.force_steps: 5 needs a force among outputs and force.fit 'slopes'"
    assert error(start + flat + end) == message
    normals = start.replace("[", '["normals", ')
    message = "training.force_steps: 5 leaves no normals, and outputs has 'normals'"
    assert error(normals + flat + slopes + end) == message
    starts = "[training]\nforce_starts = 2\n"
    assert error(start + flat + slopes + starts) == "training.force_starts: 2 needs training.force_steps"
    passes = "[training]\nforce_passes = 9\n"
    assert error(start + flat + slopes + passes) == "training.force_passes: 9 needs training.force_steps"


def test_rounded_weights_are_felt_on_whole_frames():
    start = 'name = "x"\noutputs = ["normals"]\nsensor = { geometry = "flat" }\n[training]\n'
    start += "weight_rounding_noise = true\n"
    message = "training.weight_rounding_noise: true needs training.depth_weight or training.force_weight"
    assert error(start) == message
    assert parse(start + "depth_weight = 0.5\n", origin="x").felt_weight_bits == 8
    assert parse(start.replace("true", "false"), origin="x").felt_weight_bits is None


def test_a_scene_does_not_name_a_depth_that_is_not_learned():
    assert "depth_weight" not in parse(DOTTED, origin="x").training.model_dump()
    assert "force_weight" not in parse(DOTTED, origin="x").training.model_dump()
    of_force = {"force_steps", "force_starts", "force_passes"}
    assert not of_force & set(parse(DOTTED, origin="x").training.model_dump())
