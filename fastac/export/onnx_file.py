"""A bundle's models as one ONNX file: the integers bit for bit, the float models, or both."""

import json
from importlib.metadata import version
from pathlib import Path

import numpy as np
import onnx
from onnx import helper

from fastac.export.float_graph import add_floats
from fastac.export.graph import FRAMES, IR_VERSION, OPSET, Graph
from fastac.export.integer_graph import add_integers
from fastac.models.integer.bundle import Bundle
from fastac.scenes.schema import AXES
from fastac.store.files import write_atomically

INTEGER, FLOAT, BOTH = "integer", "float", "both"
ARITHMETICS = (INTEGER, FLOAT, BOTH)
FLOAT_PREFIX = "float_"
"""Of the float models' outputs in a file that has both."""
INPUT, BACKGROUND = "frame", "background"


class ExportError(ValueError):
    """A model that cannot be written; the message is one line that says what stands in the way."""


def model_of(bundle: Bundle, *, arithmetic: str = INTEGER, background_input: bool = False) -> onnx.ModelProto:
    """The model of a bundle, checked by ONNX' own checker.

    arithmetic : one of ARITHMETICS
    background_input : whether the background is a second input, or the bundle's

    Its input `frame` is (frames, H, W, C) uint8; its outputs have the names of `models/result.py`, and those
    of the float models begin with FLOAT_PREFIX where integers are beside them.
    Raises ExportError for a bundle that has no float models, or whose force or slip follows from dots.
    """
    _require_expressible(bundle, arithmetic, background_input)
    pipeline, graph = bundle.pipeline, Graph()
    shape, channels = pipeline.background.shape, bundle.scene.sensor.channel_names
    about = f"channels {', '.join(channels)}"
    frames = graph.cast(graph.input(INPUT, np.uint8, (FRAMES, *shape), about), np.int32)
    known = graph.table(pipeline.background)
    if background_input:
        known = graph.input(BACKGROUND, np.uint8, shape, f"of the untouched sensor; {about}")
    background = graph.cast(known, np.int32)
    try:
        if arithmetic != FLOAT:
            add_integers(graph, pipeline, frames, background)
        if arithmetic != INTEGER:
            from fastac.models.floating.pipeline import FloatPipeline

            floats = FloatPipeline.from_bundle(bundle)
            add_floats(graph, floats, frames, background, FLOAT_PREFIX if arithmetic == BOTH else "")
    except ValueError as error:
        raise ExportError(f"scene {bundle.scene.name}: {error}") from None
    model = helper.make_model(
        graph.proto(bundle.scene.name),
        producer_name="fastac",
        producer_version=version("fastac"),
        opset_imports=[helper.make_opsetid("", OPSET)],
        ir_version=IR_VERSION,
        doc_string=f"{bundle.scene.name}: a vision-based tactile sensor's models ({arithmetic})",
    )
    helper.set_model_props(model, _facts(bundle, arithmetic, model))
    onnx.checker.check_model(model, full_check=True)
    return model


def _require_expressible(bundle: Bundle, arithmetic: str, background_input: bool) -> None:
    scene = bundle.scene
    if scene.wants_dots:
        what = "the output slip and force.dots" if scene.wants_slip else "force.dots"
        raise ExportError(
            f"scene {scene.name}: {what}: there is no ONNX of dots that are followed through windows;"
            " run the bundle with fastac instead"
        )
    if arithmetic == INTEGER:
        return
    if "network.0.weight" not in bundle.floats:
        raise ExportError(f"scene {scene.name}: the bundle has no float models; use --arithmetic integer")
    if background_input and bundle.pipeline.bridge is not None:
        raise ExportError(
            f"scene {scene.name}: network.bridge_dots: the float models' slopes at rest follow from the known"
            " background; leave --background-input away, or use --arithmetic integer"
        )


def _facts(bundle: Bundle, arithmetic: str, model: onnx.ModelProto) -> dict[str, str]:
    """What the file says of itself, as texts by name."""
    scene, pipeline = bundle.scene, bundle.pipeline
    facts = {
        "scene": scene.name,
        "bundle_sha256": bundle.digest,
        "arithmetic": arithmetic,
        "channels": ",".join(scene.sensor.channel_names),
        "pitch_mm": repr(scene.sensor.pitch_mm),
        "slope_per_unit": repr(2.0**-pipeline.ratio.fraction),
        "units": json.dumps({value.name: value.doc_string for value in model.graph.output}),
    }
    if scene.wants_force:
        facts["force_axes"] = ",".join(AXES[axis] for axis in scene.force_axes)
        facts["force_n_per_unit"] = json.dumps([float(value) for value in pipeline.force_n_per_unit])
    if pipeline.solver is not None:
        facts["depth_mm_per_unit"] = repr(pipeline.depth_mm_per_unit)
    return facts


def rows(model: onnx.ModelProto) -> list[list[str]]:
    """Of each input and output its name, type, shape and what it is."""
    found = []
    for value in (*model.graph.input, *model.graph.output):
        tensor = value.type.tensor_type
        shape = ", ".join(d.dim_param or str(d.dim_value) for d in tensor.shape.dim)
        kind = helper.tensor_dtype_to_np_dtype(tensor.elem_type).name
        found.append([value.name, kind, f"({shape})", value.doc_string])
    return found


def write_onnx(model: onnx.ModelProto, output: Path) -> None:
    """Write a model; the file appears whole or not at all."""
    with write_atomically(output) as temporary:
        temporary.write_bytes(model.SerializeToString(deterministic=True))
