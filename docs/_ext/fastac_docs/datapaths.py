# amaranth: UnusedElaboratable=no
"""The datapaths of the scenes in Markdown: a diagram each, and their clocks and DSP slices."""

from functools import cache
from pathlib import Path

from fastac.gateware.datapath import Datapath
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.scenes import schema
from fastac.scenes.schema import Scene
from fastac.synth.fits import random_pipeline
from fastac_docs.drawing import svg
from fastac_docs.graph import datapath_graph

SCENES = Path(schema.__file__).parent
NAMES = {"axis": "first pixel", "normals": "normals", "depth": "depth", "force": "force"}


@cache
def pipeline_of(name: str) -> IntegerPipeline:
    """The pipeline of scenes/NAME.toml with random weights: widths and clocks need no training."""
    return random_pipeline(schema.load(SCENES / f"{name}.toml"))


def datapath(name: str) -> str:
    """The diagram of a shipped scene, and a table of where its clocks and DSP slices go."""
    return of_pipeline(pipeline_of(name))


def of_pipeline(pipeline: IntegerPipeline) -> str:
    scene, path = pipeline.scene, Datapath(pipeline)
    graph = datapath_graph(pipeline)
    label = f"Datapath of scene {scene.name}: " + ", ".join(
        block.title for block in graph.blocks if block.kind == "component"
    )
    return "\n".join(
        [
            '<div class="block-diagram-frame">',
            svg(graph, label=label),
            "</div>",
            "",
            _sentence(scene, path),
            "",
            "| stage | clocks that it adds |",
            "|---|---|",
            *(f"| {stage.replace('_', ' ')} | {clocks:,} |" for stage, clocks in path.stages.items()),
            f"| **first pixel to result** | **{path.first_pixel_to_result:,}** |",
        ]
    )


def _sentence(scene: Scene, path: Datapath) -> str:
    slices = ", ".join(f"{name} {count}" for name, count in path.multipliers.items())
    lanes = scene.lanes
    return (
        f"{scene.sensor.height_px} × {scene.sensor.width_px} pixels, {lanes} a clock; a new frame every"
        f" {path.interval:,} clocks. DSP slices by formula: {sum(path.multipliers.values()):,} ({slices})."
    )
