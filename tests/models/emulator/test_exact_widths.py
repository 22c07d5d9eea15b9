"""Where float32 and float64 end: the emulator changes its type, or gives way to the loop of int64."""

from dataclasses import replace

import numpy as np
import pytest
from emulated import check, frames_of, int64_loop

from fastac.models import random_bundle
from fastac.models.emulator.exact import ExactTables
from fastac.models.emulator.exactness import EXACT, NotExactError, require_exact
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer.network import Layer, Requantisation
from fastac.models.integer.sine_transform import SineTransform

DEPTH, Z, XYZ = "depth", "force_z", "force_xyz"


def hidden_type(pipeline) -> np.dtype:
    """In which the hidden layers are computed."""
    _, hidden, *_ = ExactTables(pipeline).network.tables
    return hidden.dtype


def test_sums_beyond_float32(tmp_path):
    """A hidden layer whose sums take more than 24 bits."""
    pipeline = random_bundle.random_bundle(tmp_path / "b", random_bundle.scene((DEPTH, Z))).pipeline
    assert hidden_type(pipeline) == np.float32
    first, *others = pipeline.layers
    scale, by = first.requantisation, 12
    fine = replace(
        first,
        weight=(first.weight << by) + 1,
        bias=first.bias << by,
        weight_bits=first.weight_bits + by,
        requantisation=replace(scale, shift=scale.shift + by),
    )
    wide = pipeline.replace(layers=(fine, *others))
    assert hidden_type(wide) == np.float64
    check(wide, frames_of(pipeline.background))


def no_sines(pipeline):
    """Symmetric tables that the folded transforms cannot use."""
    transform = pipeline.solver.row_forward
    matrix = transform.matrix.copy()
    matrix[0, 0] += 1
    return pipeline.replace(solver=replace(pipeline.solver, row_forward=replace(transform, matrix=matrix)))


@pytest.mark.parametrize("solver", ["dst2d", "tridiagonal"])
def test_other_matrices_give_way_to_the_loop(tmp_path, solver):
    pipeline = random_bundle.random_bundle(
        tmp_path / "b", random_bundle.scene((DEPTH,), solver=solver)
    ).pipeline
    changed = no_sines(pipeline)
    with pytest.raises(NotExactError, match=r"^row_forward matrix: expected rows even and odd"):
        ExactTables(changed)
    frames = frames_of(pipeline.background)[3:5]
    np.testing.assert_array_equal(
        Emulator(changed).run(frames).depth_words, int64_loop(changed, frames)["depth_words"]
    )


def test_exactness_ends_at_2_to_the_53():
    require_exact("sum", EXACT - 1)
    with pytest.raises(NotExactError, match=f"sum bound {1 << 53}: integers of 2\\*\\*53 and more"):
        require_exact("sum", 1 << 53)
    assert float(EXACT - 1) != float(EXACT)
    assert float(EXACT) == float(EXACT + 1)


def wide_layer(pipeline):
    """Sums of 39 bits, which float64 holds, and multipliers of 17 bits, with which it does not."""
    first = pipeline.layers[0]
    weight = np.where(first.weight < 0, -(1 << 29), 1 << 29) + first.weight
    scale = Requantisation(np.full(len(weight), (1 << 17) - 1), 47, 10)
    wide = Layer(weight, first.bias, first.input_limit, 32, scale)
    return pipeline.replace(layers=(wide, *pipeline.layers[1:]))


def wide_ratio(pipeline):
    return pipeline.replace(ratio=replace(pipeline.ratio, fraction=40, width=50))


def wide_transform(name):
    def change(pipeline):
        transform = getattr(pipeline.solver, name)
        by = 53 - transform.accumulator_bound.bit_length() + 1
        wide = SineTransform(
            transform.matrix << by, transform.shift + by, transform.input_width, transform.output_width
        )
        return pipeline.replace(solver=replace(pipeline.solver, **{name: wide}))

    return change


def wide_stage(name):
    def change(pipeline):
        wide = replace(getattr(pipeline.solver, name), input_width=50)
        return pipeline.replace(solver=replace(pipeline.solver, **{name: wide}))

    return change


def wide_force(pipeline):
    force = pipeline.force
    return pipeline.replace(
        force=replace(force, kernel=force.kernel << 35, kernel_bits=force.kernel_bits + 35)
    )


@pytest.mark.parametrize(
    ("solver", "stage", "change"),
    [
        ("dst2d", "layer", wide_layer),
        ("dst2d", "slopes", wide_ratio),
        ("dst2d", "row_forward", wide_transform("row_forward")),
        ("dst2d", "column_forward", wide_transform("column_forward")),
        ("dst2d", "division", wide_stage("division")),
        ("dst2d", "column_inverse", wide_transform("column_inverse")),
        ("tridiagonal", "row_inverse", wide_transform("row_inverse")),
        ("tridiagonal", "elimination", wide_stage("elimination")),
        ("tridiagonal", "substitution", wide_stage("substitution")),
        ("dst2d", "force", wide_force),
    ],
)
def test_tables_too_wide_for_float64_give_way_to_the_loop(tmp_path, solver, stage, change):
    scene = random_bundle.scene((DEPTH, Z), solver=solver)
    pipeline = random_bundle.random_bundle(tmp_path / "b", scene).pipeline
    ExactTables(pipeline)
    wide = change(pipeline)
    with pytest.raises(NotExactError, match=f"^{stage} bound "):
        ExactTables(wide)
    frames = frames_of(pipeline.background)[3:7]
    found, loop = Emulator(wide).run(frames), int64_loop(wide, frames)
    for name, array in loop.items():
        np.testing.assert_array_equal(getattr(found, name), array)
    if stage == "force":
        np.testing.assert_array_equal(found.force_raw, wide.force(found.displacement_words))
