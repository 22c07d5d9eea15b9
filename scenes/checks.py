"""What a scene's tables must agree on: checks that no table can make alone.

A `scene` is a Scene of scenes/schema.py, which calls `check_scene`.
"""

import math

from fastac.scenes.force_fits import FITS
from fastac.scenes.outputs import OUTPUTS
from fastac.scenes.parts import check_part
from fastac.scenes.solvers import SOLVERS
from fastac.scenes.strict import listed, require_known

DOT_BLOCK_PX = 4
"""Side of the squares in which dots are told from the skin by one threshold."""
OF_NORMALS = (
    "teachers",
    "flat_fraction",
    "position_noise",
    "circle_margin",
    "flat_beyond",
    "huber_delta",
    "depth_weight",
    "force_weight",
    "force_steps",
    "force_starts",
    "force_passes",
    "rounding_noise",
    "weight_rounding_noise",
    "normals_share",
    "still_share",
    "initial_weights",
)
"""Keys of `training` for networks that learn from normals."""


def check_scene(scene) -> None:
    """Raise ValueError, one line that names key and value, unless a scene's tables go together."""
    for place, name in enumerate(scene.outputs):
        require_known(f"outputs.{place}", name, OUTPUTS)
    require_known("poisson.solver", scene.poisson.solver, SOLVERS)
    require_known("force.fit", scene.force.fit, FITS)
    check_part(scene.hardware.part, scene.hardware.clock_mhz)
    if scene.hardware.pixels_per_clock == "camera" and scene.camera_clocks_per_pixel is None:
        raise ValueError("hardware.pixels_per_clock: 'camera' needs sensor.frames_per_second")
    _check_widths(scene)
    _check_dots(scene)
    _check_outputs(scene)
    _check_solver(scene)
    if scene.training.labels == "force":
        _check_force_alone(scene)
    else:
        _check_sums(scene)
        for key in ("light_noise", "curl_weight", "press_symmetry"):
            if (value := getattr(scene.training, key)) is not None:
                raise ValueError(f"training.{key}: {_as_toml(value)} needs training.labels 'force'")
    if scene.protocol.tangential_shares and not scene.sensor.elastomer.friction:
        raise ValueError(
            "protocol.tangential_shares: only friction carries them; set sensor.elastomer.friction and"
            " mechanics = 'fem'"
        )
    if scene.sensor.geometry == "fingertip":
        a, b, _ = scene.sensor.ellipsoid.semi_axes_mm
        half_u = scene.sensor.width_px * scene.sensor.pitch_mm / 2
        half_v = scene.sensor.height_px * scene.sensor.pitch_mm / 2
        if math.hypot(half_u / a, half_v / b) >= math.sqrt(0.95):
            raise ValueError(
                f"sensor.ellipsoid.semi_axes_mm: {a} x {b} do not span the image"
                f" ({2 * half_u:g} x {2 * half_v:g} mm)"
            )


def _check_widths(scene) -> None:
    """Raise ValueError unless the network's widths go together."""
    network = scene.network
    for layer, (trained, kept) in enumerate(zip(network.trained, network.hidden, strict=True), 1):
        if trained < kept:
            raise ValueError(
                f"network.train_width: {trained} in hidden layer {layer}: expected at least the {kept} of"
                " network.width"
            )
    if network.train_width is not None and scene.training.labels == "force":
        raise ValueError("network.train_width: needs training.labels 'geometry', normals to judge neurons by")


def _check_outputs(scene) -> None:
    """Raise ValueError unless the outputs can be given together, by a hardware of whole beats."""
    if len(set(scene.outputs)) != len(scene.outputs):
        raise ValueError("outputs: named twice")
    if len(set(scene.force_axes)) != len(scene.force_axes):
        raise ValueError("outputs: force_xyz has all three axes; name none beside it")
    lanes = scene.lanes
    if scene.sensor.width_px % lanes:
        raise ValueError(
            f"hardware.pixels_per_clock: {lanes} does not divide sensor.width_px {scene.sensor.width_px}"
        )
    for name in scene.outputs:
        facts = OUTPUTS[name]
        patches = not facts.needs_patches or scene.force.kernel == "patch"
        if facts.needs_force and not (scene.force_from_displacement and patches):
            kernel = ", force.kernel 'patch'," if facts.needs_patches else ""
            raise ValueError(
                f"outputs: {name} needs a force beside it{kernel} and a poisson.solver with depth, and"
                " not force.source 'slopes'"
            )
        if facts.needs_dots and not scene.wants_dots:
            raise ValueError(f"outputs: {name} needs force.dots = true and a force beside it")


def _check_solver(scene) -> None:
    """Raise ValueError unless the solver can do what is wanted of it."""
    sensor, solver, facts = scene.sensor, scene.poisson.solver, scene.solver_facts
    from_displacement = scene.force_from_slopes and not scene.fit_facts.of_slopes
    of_depth = scene.wants_solver or from_displacement
    if facts.square_images and of_depth and sensor.height_px != sensor.width_px:
        raise ValueError(
            f"sensor.height_px: {sensor.height_px} differs from width_px {sensor.width_px};"
            " the DST engine shares one matrix between rows and columns, so depth needs square images"
        )
    if scene.wants_solver and not facts.finds_depth:
        others = (name for name in SOLVERS if SOLVERS[name].finds_depth)
        raise ValueError(f"poisson.solver: {solver!r} finds no depth; choose {listed(others)}")
    if scene.force.source == "displacement" and not facts.finds_depth:
        raise ValueError(f"force.source: 'displacement' needs a poisson.solver with depth, not {solver!r}")
    if scene.force.source == "slopes" and not scene.wants_force:
        raise ValueError("force.source: 'slopes' needs a force among outputs")
    if scene.force.source == "slopes" and facts.finds_depth and not scene.wants_solver:
        without = listed(name for name in SOLVERS if not SOLVERS[name].finds_depth)
        raise ValueError(f"force.source: 'slopes' without output depth needs poisson.solver {without}")
    if scene.force.coverage is not None and not scene.wants_force:
        raise ValueError("force.coverage: needs a force among outputs")
    if scene.wants_force and scene.force.clamp and not (facts.can_clamp and scene.force_from_displacement):
        linear = "a force of slopes" if facts.can_clamp else f"the {solver}"
        raise ValueError(f"force.clamp: {linear} is linear and cannot clamp; set clamp = false")
    if scene.fit_facts.of_slopes and facts.finds_depth and scene.force.source != "slopes":
        without = listed(name for name in SOLVERS if not SOLVERS[name].finds_depth)
        raise ValueError(
            f"force.fit: {scene.force.fit!r} needs force.source 'slopes' or poisson.solver {without}"
        )
    _check_weights(scene)
    lanes = scene.lanes
    row_beats = -(-scene.inner_px // lanes)
    if scene.wants_solver and row_beats < facts.least_row_beats:
        raise ValueError(
            f"poisson.solver: {solver!r} needs rows of {facts.least_row_beats} beats or more;"
            f" {scene.inner_px} values at {lanes} pixels_per_clock are {row_beats}"
        )


def _check_weights(scene) -> None:
    """Raise ValueError unless the force can be a sum of weights of the pixels where it is to be one."""
    force, of_weights = scene.force, scene.fit_facts.of_weights
    finds_displacement = scene.solver_facts.finds_depth and force.source != "slopes"
    if of_weights and not (force.kernel == "collapsed" and finds_displacement):
        raise ValueError(
            f"force.fit: {force.fit!r} needs force.kernel 'collapsed' and a poisson.solver with depth,"
            " and not force.source 'slopes'"
        )
    if force.band_mm and not of_weights:
        raise ValueError(f"force.band_mm: {force.band_mm:g} needs force.fit 'weights' or 'polynomials'")
    if force.deep_mm and not (force.band_mm and force.band_mm < force.depths_mm[0]):
        raise ValueError(f"force.deep_mm: {force.depths_mm[0]:g} needs a force.band_mm that is smaller")
    if force.block_px > 1 and not (of_weights or scene.force_from_slopes):
        raise ValueError(
            f"force.block_px: {force.block_px} needs force.fit 'weights' or 'polynomials', or a force of"
            " slopes"
        )


def _check_dots(scene) -> None:
    """Raise ValueError unless dots can be seen where they are to be."""
    wanted = {"force.dots": scene.force.dots, "network.bridge_dots": scene.network.bridge_dots}
    keys = [key for key, value in wanted.items() if value]
    if not keys:
        return
    sensor = scene.sensor
    if sensor.markers is None:
        raise ValueError(f"{keys[0]}: True needs dots on the skin, a table sensor.markers")
    for key in ("height_px", "width_px"):
        side = getattr(sensor, key)
        if side % DOT_BLOCK_PX:
            raise ValueError(f"sensor.{key}: {side}: {keys[0]} needs a multiple of {DOT_BLOCK_PX}")
    if scene.network.bridge_dots and not scene.wants_slopes:
        raise ValueError("network.bridge_dots: True needs an output that follows from slopes")
    if scene.force.dots and not scene.wants_force:
        raise ValueError("force.dots: True needs a force among outputs")
    if scene.network.smoothing_px and scene.wants_darkness:
        raise ValueError(
            f"network.smoothing_px: {scene.network.smoothing_px} needs network.bridge_dots and force.dots to"
            " be false: a window that holds a dot darkens the skin beside it"
        )
    if scene.force.dots and scene.wants_force_map:
        raise ValueError("force.dots: True: dots' shifts belong to no pixel; leave out output force_map")


def _check_sums(scene) -> None:
    """Raise ValueError where a network cannot learn from the depth or the force of whole frames."""
    weight, sensor = scene.training.depth_weight, scene.sensor
    if weight and sensor.height_px != sensor.width_px:
        shape = f"{sensor.height_px} x {sensor.width_px}"
        raise ValueError(f"training.depth_weight: {weight} needs square images, and sensor has {shape} px")
    weight, learnable = scene.training.force_weight, scene.fit_facts.of_slopes or scene.fit_facts.of_kernels
    if weight and not (scene.wants_force and learnable and not scene.force.dots):
        raise ValueError(
            f"training.force_weight: {weight} needs a force among outputs, force.fit 'slopes' or"
            " 'displacement' and force.dots false"
        )
    if steps := scene.training.force_steps:
        if not (scene.wants_force and scene.fit_facts.of_slopes):
            raise ValueError(
                f"training.force_steps: {steps} needs a force among outputs and force.fit 'slopes'"
            )
        if spoilt := [name for name in scene.outputs if OUTPUTS[name].needs_geometry]:
            raise ValueError(
                f"training.force_steps: {steps} leaves no normals, and outputs has {listed(spoilt)}"
            )
    if (starts := scene.training.force_starts) > 1 and not steps:
        raise ValueError(f"training.force_starts: {starts} needs training.force_steps")
    if (passes := scene.training.force_passes) and not steps:
        raise ValueError(f"training.force_passes: {passes} needs training.force_steps")
    if scene.training.weight_rounding_noise and not (scene.training.depth_weight or weight):
        raise ValueError(
            "training.weight_rounding_noise: true needs training.depth_weight or training.force_weight"
        )


def _check_force_alone(scene) -> None:
    """Raise ValueError unless forces alone can train what is wanted."""
    if not scene.force_from_slopes or scene.wants_geometry or not scene.fit_facts.of_slopes:
        raise ValueError(
            "training.labels: 'force' gives forces only, no normals or depth, and needs poisson.solver"
            " 'adjoint' and force.fit 'slopes'"
        )
    for key in OF_NORMALS:
        value = getattr(scene.training, key)
        if value != type(scene.training).model_fields[key].default:
            raise ValueError(f"training.{key}: {_as_toml(value)} needs training.labels 'geometry'")
    if scene.force.dots and scene.training.press_symmetry:  # their shifts belong to their places
        raise ValueError("training.press_symmetry: true needs force.dots = false")


def _as_toml(value: bool | float | str) -> str:
    """A value of a scene as a scene file has it."""
    return repr(value) if isinstance(value, str) else str(value).lower()
