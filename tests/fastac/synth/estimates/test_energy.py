"""The estimate of energy, counted by hand for frames of 16×16 pixels: 256 pixels, 14×14 = 196 inner ones."""

from dataclasses import replace

import numpy as np
import pytest

from fastac.gateware.arithmetic.shift_add import canonical_signed_digits
from fastac.models import random_bundle
from fastac.models.integer import assemble
from fastac.models.integer.force import PatchForce
from fastac.models.integer.force_segments import segment_slopes
from fastac.models.integer.network import Layer, Requantisation
from fastac.models.integer.words import signed_width
from fastac.synth.estimates import energy

PIXELS, INNER, SIDE = 256, 196, 14


@pytest.fixture(scope="module")
def make_pipeline(tiny_bundle, make_scene):
    """Pipelines of the tiny sensor with the tables that a changed scene wants."""
    trained = tiny_bundle.pipeline

    def make(**changes):
        scene = make_scene(**changes)
        pipeline = assemble.assemble(
            scene,
            layers=trained.layers,
            background=trained.background,
            rest_depth_mm=trained.rest_depth_mm,
        )
        if scene.force_from_slopes:
            return assemble.with_force(pipeline, np.ones((len(scene.force_axes), 16, 16, 2)))
        if scene.wants_force:
            return assemble.with_force(pipeline, np.ones((len(scene.force_axes), SIDE, SIDE, 5, 5)))
        return pipeline

    return make


def counts(stage: list[energy.Work], kind: str) -> list[tuple[int, int]]:
    """(count, bits) of one kind of operation, in order."""
    return [(work.count, work.bits) for work in stage if work.kind == kind]


class TestEnergies:
    """Horowitz's own figures, and what lies between them."""

    def test_published_points(self):
        assert energy.addition(1, 8).pj == pytest.approx(0.03)
        assert energy.addition(1, 32).pj == pytest.approx(0.1)
        assert energy.multiplication(1, 8, 8).pj == pytest.approx(0.2)
        assert energy.multiplication(1, 32, 32).pj == pytest.approx(3.1)
        assert energy.memory(1, 64, 1024).pj == pytest.approx(10)
        assert energy.memory(1, 64, 4096).pj == pytest.approx(20)

    def test_between_them(self):
        assert energy.addition(1, 20).pj == pytest.approx(0.065)
        assert energy.multiplication(1, 16, 4).pj == pytest.approx(0.2)  # the product of the widths counts
        assert 0.7 < energy.multiplication(1, 16, 16).pj < 0.8
        assert energy.memory(1, 16, 256).pj == pytest.approx(1.25)
        assert energy.register(1, 32).pj == pytest.approx(2 * 10 / 2 / 32)

    def test_totals(self):
        assert energy.addition(1000, 8).total_pj == pytest.approx(30)


class TestCounts:
    def test_background(self, make_pipeline):
        stage = energy.works(make_pipeline(outputs=["normals"]))["background"]
        assert counts(stage, "memory") == [(PIXELS, 32), (PIXELS, 9), (PIXELS, 9)]
        assert counts(stage, "addition") == [(PIXELS * 4, 9)]
        assert counts(stage, "register") == [(PIXELS * 4, 9)]

    def test_lanes_make_words_wider_and_fewer(self, make_pipeline):
        stage = energy.works(make_pipeline(outputs=["normals"], hardware={"pixels_per_clock": 4}))
        assert counts(stage["background"], "memory") == [(64, 128), (64, 36), (64, 9)]
        assert counts(stage["background"], "addition") == [(PIXELS * 4, 9)]

    @pytest.mark.parametrize(("lanes", "held"), [(1, 4), (2, 2), (4, 2)])
    def test_smoothing(self, make_pipeline, lanes, held):
        """A window of 4: 5 words of 9 bits down the rows, 5 sums of 12 along the columns, four channels."""
        changes = {"outputs": ["normals"], "hardware": {"pixels_per_clock": lanes}}
        stages = energy.works(make_pipeline(network={"smoothing_px": 4}, **changes))
        assert list(stages) == ["background", "smoothing", "normals"]
        stage, values = stages["smoothing"], PIXELS * 4
        beats = PIXELS // lanes
        assert counts(stage, "memory") == [(2 * beats, 4 * 36 * lanes), (beats, 9 * lanes), (beats, 9)]
        additions = [(values * 4, 12), (values * 4, 15), (values, 15)]
        assert counts(stage, "addition") == additions
        # Each word as it comes and as it is chosen; a lane's sums as far as the window reaches into beats.
        assert counts(stage, "register") == [(values * 10, 9), (values * (held + 5), 12), *additions]
        without = energy.works(make_pipeline(**changes))
        assert list(without) == ["background", "normals"]
        assert without["normals"] == stages["normals"]

    @pytest.mark.parametrize("loadable", [True, False])
    def test_weights(self, make_pipeline, loadable):
        """Three neurons of two inputs: two share their multipliers, or all are shifts and additions."""
        hidden = Layer(
            weight=np.array([[3, 0], [7, -1], [0, 0]]),
            bias=np.array([5, 0, 9]),
            input_limit=np.array([255, 127]),
            requantisation=Requantisation(np.array([1, 5, 7]), shift=4, bits=7),
            loadable=loadable,
        )
        stage = energy.works(make_pipeline(outputs=["normals"]).replace(layers=(hidden,)))["normals"]
        wide = hidden.accumulator_width
        if loadable:
            # ±127 · (255 + 127) needs a field of 17 bits; two weights in one word have 8 + 17.
            assert counts(stage, "multiplication") == [
                (PIXELS * 2, 25 + 9),  # two packed products,
                (PIXELS * 2, 8 + 9),  # two of the neuron left over,
                (PIXELS * 3, wide + 17),  # three multipliers
            ]
            # One packed sum, split into two with biases; a sum and a bias of the neuron left over.
            assert counts(stage, "addition") == [(PIXELS, 34), (PIXELS * 2, wide), (PIXELS * 2, wide)]
        else:
            assert counts(stage, "multiplication") == []
            # 4x − x, 8x − y, 8x − y − x; two biases; a + 4a, where a has 9 bits unless it is clipped, 8a − a.
            assert sum(n for n, _ in counts(stage, "addition")) == 7 * PIXELS
            widths = {bits: n // PIXELS for n, bits in counts(stage, "addition")}
            assert widths == {11: 2, 13: 1, 12: 2, 12 - 2: 1, 6: 1}
        assert counts(stage, "memory") == []

    def test_gradients(self, make_pipeline):
        pipeline = make_pipeline(outputs=["depth"])
        ratio = pipeline.ratio
        assert (ratio.width, ratio.fraction) == (17, 14)
        stage = energy.works(pipeline)["gradients"]
        assert counts(stage, "addition") == [(2 * PIXELS * 18, ratio.normal_width), (2 * PIXELS, 17)]

    @pytest.mark.parametrize(("divergence", "words"), [("central", 3), ("backward", 1)])
    def test_source(self, make_pipeline, divergence, words):
        pipeline = make_pipeline(outputs=["depth"], poisson={"divergence": divergence})
        stage = energy.works(pipeline)["source"]
        assert counts(stage, "addition") == [(INNER * 4, pipeline.source.width)]
        assert counts(stage, "memory")[0] == (2 * PIXELS, words * 17)
        assert counts(stage, "memory")[1][0] == INNER

    def test_transforms(self, make_pipeline):
        """14 values a row, folded to 7: 7 products and additions and one word of 7 coefficients a value."""
        pipeline = make_pipeline(outputs=["depth"])
        stages = energy.works(pipeline)
        solver = pipeline.solver
        for name in ("row_forward", "column_forward", "column_inverse", "row_inverse"):
            transform, stage = getattr(solver, name), stages[name]
            width, coefficient = transform.input_width, transform.coefficient_width
            assert counts(stage, "multiplication") == [(INNER * 7, width + 1 + coefficient)]
            assert counts(stage, "addition") == [
                (INNER * 7, width + 1),
                (INNER * 7, transform.accumulator_width),
            ]
            assert counts(stage, "memory") == [(INNER, 7 * coefficient)]
            # 13 places shift 14 times a row, then 14 are held.
            assert counts(stage, "register")[0] == (14 * (14 * 13 + 14), width)
        for name in ("to_columns", "to_rows"):
            assert counts(stages[name], "memory")[0][0] == 2 * INNER
        assert counts(stages["division"], "multiplication") == [(INNER, solver.division.input_width + 17)]
        assert counts(stages["division"], "memory")[0][0] == INNER

    def test_a_floor_adds_no_half_unit(self, make_pipeline):
        settings = {"outputs": ["depth"], "numbers": {"rounding": "floor"}}
        stages = energy.works(make_pipeline(**settings))
        for name in ("row_forward", "column_forward", "column_inverse", "row_inverse"):
            assert [count for count, _ in counts(stages[name], "addition")] == [INNER * 7, INNER * 6]
        assert counts(stages["division"], "addition") == []
        stages = energy.works(make_pipeline(**settings, poisson={"solver": "tridiagonal"}))
        for name in ("elimination", "substitution"):  # the difference of rows, and what is known of one
            assert [count for count, _ in counts(stages[name], "addition")] == [INNER]

    def test_several_lanes_fold_once_a_row(self, make_pipeline):
        """And 4 lanes fill 4 beats of a row of 14 with 2 void places."""
        stages = energy.works(make_pipeline(outputs=["depth"], hardware={"pixels_per_clock": 4}))
        stage = stages["row_forward"]
        assert counts(stage, "addition")[0][0] == 14 * 7 * 2
        assert counts(stage, "multiplication")[0][0] == INNER * 7
        assert counts(stage, "memory")[0][0] == 14 * 4
        assert counts(stages["to_columns"], "memory")[0][0] == 2 * 14 * 4 * 4

    def test_tridiagonal(self, make_pipeline):
        pipeline = make_pipeline(outputs=["depth"], poisson={"solver": "tridiagonal"})
        stages, solver = energy.works(pipeline), pipeline.solver
        inside = ["elimination", "reversal", "substitution"]
        assert list(stages)[3:] == ["source", "row_forward", *inside, "row_inverse"]
        bits = solver.elimination.shift
        for name, additions in (("elimination", 2), ("substitution", 1)):
            stage = stages[name]
            assert [count for count, _ in counts(stage, "multiplication")] == [INNER]
            assert [count for count, _ in counts(stage, "addition")] == [INNER] * additions
            assert counts(stage, "memory") == [
                (2 * INNER, getattr(solver, name).output_width),
                (INNER, bits),
            ]
        assert counts(stages["reversal"], "memory") == [(2 * INNER, solver.elimination.output_width)]

    def test_patch_force(self, make_pipeline):
        """25 products a pixel, 24 additions and one to the total; a word of 25 kernel values."""
        pipeline = make_pipeline(outputs=["force_z"])
        assert isinstance(pipeline.force, PatchForce)
        stages = energy.works(pipeline)
        stage = stages["force"]
        assert counts(stage, "multiplication") == [(INNER * 25, 16 + 1 + 8)]
        assert counts(stage, "addition") == [
            (INNER * 24, pipeline.force.pixel_width),
            (INNER, pipeline.force.width),
        ]
        assert counts(stage, "memory") == [(2 * INNER, 4 * 16), (INNER, 25 * 8)]
        # absolute depth: rest − z, and the rounding.
        assert counts(stages["displacement"], "addition") == [(INNER, pipeline.depth.width)] * 2
        assert [count for count, _ in counts(stages["displacement"], "memory")] == [INNER]

    def test_axes_share_the_row_memory(self, make_pipeline):
        stage = energy.works(make_pipeline(outputs=["force_xyz"]))["force"]
        assert counts(stage, "multiplication") == [(3 * INNER * 25, 25)]
        assert counts(stage, "memory") == [(2 * INNER, 64), (INNER, 3 * 25 * 8)]

    def test_collapsed_force(self, make_pipeline):
        pipeline = make_pipeline(outputs=["force_z"], force={"kernel": "collapsed"})
        weight = pipeline.force.weight_width
        stage = energy.works(pipeline)["force"]
        assert counts(stage, "multiplication") == [(INNER, 16 + 1 + weight)]
        assert counts(stage, "addition") == [(INNER, pipeline.force.width)]
        assert counts(stage, "memory") == [(INNER, weight)]

    def test_adjoint_needs_no_depth(self, make_pipeline):
        pipeline = make_pipeline(outputs=["force_z"], poisson={"solver": "adjoint"}, force={"clamp": False})
        stages = energy.works(pipeline)
        assert list(stages) == ["background", "normals", "gradients", "force"]
        weight = pipeline.force.weight_width
        assert counts(stages["force"], "multiplication") == [(2 * PIXELS, 17 + weight)]
        assert counts(stages["force"], "memory") == [(PIXELS, 2 * weight)]

    def test_only_what_is_wanted(self, make_pipeline):
        assert list(energy.works(make_pipeline(outputs=["normals"]))) == ["background", "normals"]
        depth = energy.works(make_pipeline(outputs=["depth"], poisson={"mode": "difference"}))
        assert counts(depth["depth"], "addition")[0][0] == INNER
        assert "displacement" not in depth
        assert "force" not in depth


class TestDots:
    """3 × 3 dots on 24 × 24 pixels, whose slopes are bridged over 2 px."""

    @pytest.fixture
    def make(self, tmp_path):
        def pipeline(outputs=("force_xyz",), **settings):
            scene = random_bundle.scene(outputs, size=24, channels="bgr+nir", **settings)
            return random_bundle.random_bundle(tmp_path / "b", scene).pipeline

        return pipeline

    @pytest.mark.parametrize(
        ("outputs", "settings", "stages"),
        [
            (("force_z",), {"solver": "adjoint"}, set()),
            (("force_z",), {"solver": "adjoint", "bridge_dots": True}, {"darkness", "bridge"}),
            (("depth",), {"bridge_dots": True}, {"darkness", "bridge"}),
            (("force_z",), {"dots": True}, {"darkness", "dots"}),
            (("depth",), {"dots": False}, set()),
            (("force_z",), {"dots": True, "bridge_dots": True}, {"darkness", "bridge", "dots"}),
        ],
    )
    def test_stages_are_there_where_they_are_wanted(self, make, outputs, settings, stages):
        found = energy.works(make(outputs, **settings))
        assert found.keys() & {"darkness", "bridge", "dots"} == stages
        for stage in stages:
            assert sum(work.total_pj for work in found[stage]) > 0

    @pytest.mark.parametrize("lanes", [1, 4])
    def test_darkness_and_bridge(self, make, lanes):
        pipeline = make(solver="adjoint", bridge_dots=True, lanes=lanes)
        stages = energy.works(pipeline)
        windows = pipeline.bridge.windows
        assert counts(stages["darkness"], "addition") == [(576 * 4, windows.darkness_width)]
        assert windows.darkness_width == 10  # 4 · 255 at most: any threshold may be loaded
        assert pipeline.bridge.reach == 2
        ahead = {1: 2, 4: 1}[lanes]
        assert counts(stages["bridge"], "register") == [(576 * (2 * ahead + 1), 2 * pipeline.ratio.width)]

    def test_dots(self, make):
        """144 cells; windows of 3 × 3 of them, 10 × 10; 9 dots with two weights for each of three axes."""
        pipeline = make(solver="adjoint", dots=True)
        follower, weighted = pipeline.follower, pipeline.dot_force.weighted
        windows = follower.windows
        assert (windows.half, windows.shape, len(follower.rest)) == (1, (10, 10), 9)
        words = windows.mass_width + 2 * windows.moment_width
        stage = energy.works(pipeline)["dots"]
        assert counts(stage, "memory") == [(144, 2 * words), (100 + 18, words)]
        assert counts(stage, "multiplication") == [(54, weighted.input_width + weighted.weight_width)]
        sums, divisions, force = counts(stage, "addition")
        assert sums == (2 * 144 * 3, words)
        assert divisions[0] % 18 == 0
        assert force == (54 + 3, weighted.width)

    @pytest.mark.parametrize(("bends_mm", "terms"), [((0.002,), 3), ((0.002, 0.004), 4)])
    def test_a_bent_force_takes_one_product_of_its_segments_slopes(self, make, bends_mm, terms):
        settings = dict(zip(("band_mm", "deep_mm"), bends_mm, strict=False))
        pipeline = make(kernel="collapsed", solver="tridiagonal", **settings)
        force, pixels = pipeline.force, 484 * 3
        slope = signed_width(int(np.abs(segment_slopes(force.weight)).max()))
        stage = energy.works(pipeline)["force"]
        assert counts(stage, "memory") == [(484, 3 * terms * slope)]
        assert counts(stage, "multiplication") == [(pixels, force.input_width + slope)]
        changes, *multiples, total = counts(stage, "addition")
        assert changes == (pixels * len(bends_mm), slope + 1)
        digits = [len(canonical_signed_digits(bend)) for bend in pipeline.bends]
        assert [count for count, _ in multiples] == [pixels * count for count in digits]
        assert total == (pixels, force.width)

    @pytest.mark.parametrize(
        ("lanes", "reads", "squares"), [(1, 22 * 22, 1), (4, 22 * 6, 2), ("1/4", 22 * 22, 1)]
    )
    def test_squares_are_read_by_the_beat_in_the_bits_that_each_weight_needs(
        self, make, lanes, reads, squares
    ):
        pipeline = make(
            kernel="collapsed", solver="tridiagonal", band_mm=0.002, deep_mm=0.004, block_px=2, lanes=lanes
        )
        force = pipeline.force
        table = force.block_weight if lanes == "1/4" else segment_slopes(force.block_weight)
        bits = sum(signed_width(int(bound)) for bound in np.abs(table).max(axis=(1, 2)).ravel())
        assert counts(energy.works(pipeline)["force"], "memory") == [(reads, squares * bits)]

    def test_a_folded_bent_force_takes_a_product_for_itself_and_for_each_bend(self, make):
        """A displacement is beyond the band on one side or on none."""
        pipeline = make(kernel="collapsed", solver="tridiagonal", band_mm=0.002, deep_mm=0.004, lanes="1/4")
        weight = pipeline.force.weight_width
        widest = np.abs(pipeline.force.weight).max(axis=(1, 2)).ravel().tolist()
        stage = energy.works(pipeline)["force"]
        assert counts(stage, "memory") == [(484, sum(bound.bit_length() + 1 for bound in widest))]
        assert counts(stage, "multiplication") == [(484 * 3 * 3, pipeline.force.input_width + weight)]


class TestEstimate:
    def test_parts_add_up_and_say_what_they_are(self, make_pipeline):
        found = energy.estimate(make_pipeline())
        total = found["energy_estimate_uj_per_frame"]
        assert total["origin"].startswith("estimated: ")
        for word in ("Horowitz", "45 nm", "off-chip", "static", "excluded"):
            assert word in total["origin"]
        for split in ("by_stage", "by_kind"):
            parts = found[f"energy_estimate_uj_per_frame_{split}"]
            assert sum(parts["value"].values()) == pytest.approx(total["value"])
            assert parts["origin"].startswith("estimated: ")
        assert set(found["energy_estimate_uj_per_frame_by_kind"]["value"]) == {
            "addition",
            "memory",
            "multiplication",
            "register",
        }

    def test_one_stage_in_full(self, make_pipeline):
        """196 weights of the collapsed kernel, by the formulas of the origin."""
        pipeline = make_pipeline(outputs=["force_z"], force={"kernel": "collapsed"})
        weight, width = pipeline.force.weight_width, pipeline.force.width
        one = 0.2 * (17 * weight / 64) ** 0.98858  # product
        one += 0.03 + 0.07 * (width - 8) / 24  # sum
        one += 10 * weight / 64 * (INNER / 1024) ** 0.5  # weight read
        one += 2 * 10 / 64 / 32 * (17 + weight + width)  # registers of product and sum
        found = energy.estimate(pipeline)["energy_estimate_uj_per_frame_by_stage"]["value"]["force"]
        assert found == pytest.approx(INNER * one * 1e-6, rel=1e-4)

    def test_what_is_cheaper(self, make_pipeline):
        def total(**changes):
            return energy.estimate(make_pipeline(**changes))["energy_estimate_uj_per_frame"]["value"]

        patch = total(outputs=["force_z"])
        collapsed = total(outputs=["force_z"], force={"kernel": "collapsed"})
        tridiagonal = total(outputs=["force_z"], poisson={"solver": "tridiagonal"})
        adjoint = total(outputs=["force_z"], poisson={"solver": "adjoint"}, force={"clamp": False})
        assert adjoint < collapsed < patch
        assert adjoint < tridiagonal < patch

    def test_the_trained_pipeline(self, tiny_bundle):
        pipeline = tiny_bundle.pipeline
        layers = tuple(replace(layer, loadable=False) for layer in pipeline.layers)
        baked = energy.works(pipeline.replace(layers=layers))["normals"]
        assert counts(baked, "multiplication") == []
        biases = sum(len(layer.weight) for layer in layers)
        digits = sum(np.count_nonzero(layer.weight) for layer in layers) * 4
        assert PIXELS * biases < sum(count for count, _ in counts(baked, "addition")) < PIXELS * digits
