# amaranth: UnusedElaboratable=no
"""The datapath's large stages for a pipeline: as wide as its scene's lanes, or folded over several clocks."""

from dataclasses import replace

from fastac.gateware.force.folded_patch import FoldedPatchForce
from fastac.gateware.force.folded_sum import FoldedWeightedSum
from fastac.gateware.force.weighted_sum import WeightedSumStream
from fastac.gateware.fz_stream import PatchForceStream
from fastac.gateware.network.feature_smoothing import FeatureSmoothing
from fastac.gateware.network.folded_network import FoldedMlp
from fastac.gateware.network.folded_ratio import FoldedDivider
from fastac.gateware.network.gradient_ratio import GradientDivider
from fastac.gateware.network.pixel_network import NormalMlp
from fastac.gateware.poisson.solvers import SOLVERS
from fastac.gateware.target.device import device_of
from fastac.models.integer.features import WIDTH, coordinate_codes
from fastac.models.integer.force import PatchForce, WeightedSum
from fastac.models.integer.pipeline import IntegerPipeline


def rows_reversed(pipeline: IntegerPipeline) -> bool:
    """Whether depth and what follows from it come with the last row first."""
    scene = pipeline.scene
    return scene.wants_solver and SOLVERS[scene.poisson.solver].last_row_first


def last_row_first(stage):
    """`stage` (Depth, PatchForce or WeightedSum) with the rows of its tables reversed.

    For solvers that output the last row first; the rows within each patch's kernel are reversed as well.
    """
    if isinstance(stage, PatchForce):
        return replace(stage, kernel=stage.kernel[:, ::-1, :, ::-1])
    if isinstance(stage, WeightedSum):
        return stage.reversed_rows()
    return replace(stage, rest=stage.rest[::-1])


def smoothing(pipeline: IntegerPipeline) -> FeatureSmoothing | None:
    """From features to their means over a window, where the scene wants them."""
    scene, (height, width, channels) = pipeline.scene, pipeline.background.shape
    if not scene.network.smoothing_px:
        return None
    codes = coordinate_codes(width), coordinate_codes(height)
    return FeatureSmoothing(scene.network.smoothing_px, channels, *codes, lanes=scene.lanes, fold=scene.fold)


def pixel_network(pipeline: IntegerPipeline) -> NormalMlp | FoldedMlp:
    """From features to normals."""
    scene = pipeline.scene
    if scene.fold > 1:
        return FoldedMlp(pipeline.layers, input_width=WIDTH, fold=scene.fold)
    return NormalMlp(pipeline.layers, input_width=WIDTH, lanes=scene.lanes, dsp=device_of(scene).dsp)


def divider(pipeline: IntegerPipeline) -> GradientDivider | FoldedDivider:
    """From normals to slopes."""
    scene = pipeline.scene
    if scene.fold > 1:
        return FoldedDivider(pipeline.ratio, fold=scene.fold)
    return GradientDivider(pipeline.ratio, lanes=scene.lanes)


def solver(pipeline: IntegerPipeline):
    """From slopes to the solution of Poisson's equation: an entry of SOLVERS."""
    scene = pipeline.scene
    return SOLVERS[scene.poisson.solver](
        pipeline.source,
        *pipeline.solver.parts.values(),
        height=scene.sensor.height_px,
        width=scene.sensor.width_px,
        lanes=scene.lanes,
        fold=scene.fold,
        loadable=pipeline.layers[0].loadable and scene.poisson.mode == "difference",
        dsp=device_of(scene).dsp,
    )


Force = WeightedSumStream | FoldedWeightedSum | PatchForceStream | FoldedPatchForce


def force(pipeline: IntegerPipeline) -> Force:
    """From displacements or slopes to the skin's force."""
    scene, dsp = pipeline.scene, device_of(pipeline.scene).dsp
    of_slopes = scene.force_from_slopes
    stage = last_row_first(pipeline.force) if rows_reversed(pipeline) and not of_slopes else pipeline.force
    if isinstance(stage, PatchForce):
        choice = {"wants_map": scene.wants_force_map, "dsp": dsp}
        if scene.fold > 1:
            return FoldedPatchForce(stage, fold=scene.fold, **choice)
        return PatchForceStream(stage, lanes=scene.lanes, **choice)
    choice = {"loadable": pipeline.layers[0].loadable and of_slopes, "bends": pipeline.bends, "dsp": dsp}
    if scene.fold > 1:
        return FoldedWeightedSum(stage, fold=scene.fold, **choice)
    return WeightedSumStream(stage, lanes=scene.lanes, **choice)
