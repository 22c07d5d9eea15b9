# amaranth: UnusedElaboratable=no
"""The block diagram has the hardware's own components, words and clocks."""

import pytest
from amaranth import signed, unsigned
from amaranth.lib import data

from fastac.gateware.datapath import Datapath
from fastac.models.random_bundle import random_bundle
from fastac.models.random_bundle import scene as random_scene
from fastac_docs.graph import datapath_graph, words_of


def words(graph, source, target) -> str:
    (found,) = (
        stream.words for stream in graph.streams if (stream.source, stream.target) == (source, target)
    )
    return found


def test_from_the_first_pixel_to_the_outputs(small_graph, small_bundle):
    pipeline, path = small_bundle.pipeline, Datapath(small_bundle.pipeline)
    assert words(small_graph, ":axis", "guard") == f"{2 * 3 * 8} bits"
    assert words(small_graph, "guard", "background") == "2 × 3 × unsigned 8"
    assert words(small_graph, "divider", "solver.source") == f"2 × 2 × signed {pipeline.ratio.width}"
    assert words(small_graph, "depth_output", ":depth") == f"2 × signed {pipeline.depth.width}"
    assert words(small_graph, "force_stream", ":force") == f"1 × signed {pipeline.force_width}"
    for name in ("guard", "mlp", "divider", "depth_output", "force_stream"):
        assert small_graph.block(name).latency == getattr(path, name).latency
    assert small_graph.block("mlp").multipliers == path.multipliers["normals"]
    assert small_graph.block("divider").file == "gateware/network/gradient_ratio.py"


def test_parts_of_the_solver_stand_for_it_in_order(small_graph, small_bundle):
    stages = list(Datapath(small_bundle.pipeline).solver.stages)
    parts = {block.name for block in small_graph.blocks if block.name.startswith("solver.")}
    assert {f"solver.{stage}" for stage in stages} <= parts
    assert not any("solver:" in (stream.source + stream.target) for stream in small_graph.streams)
    following = {stream.source: stream.target for stream in small_graph.streams}
    name, seen = "divider", []
    while name != "solution_buffer":
        name = following[name]
        seen.append(name.removeprefix("solver."))
    assert [name for name in seen if name in stages] == stages


@pytest.mark.parametrize(
    ("changes", "present", "absent"),
    [
        ({"outputs": ("normals",)}, {":normals"}, {"divider", "force_stream", ":force", ":depth"}),
        (
            {"outputs": ("force_xyz",), "solver": "adjoint"},
            {"divider", "force_stream", ":force"},
            {"displacement", ":depth"},
        ),
        (
            {"outputs": ("force_z",), "dots": True, "bridge_dots": True, "solver": "adjoint", "lanes": 4},
            {"darkness", "pixels_fork", "bridge", "dots"},
            {"displacement"},
        ),
    ],
    ids=["normals", "adjoint", "dots"],
)
def test_only_what_a_scene_needs(changes, present, absent, tmp_path):
    outputs = changes.pop("outputs")
    graph = datapath_graph(random_bundle(tmp_path, random_scene(outputs, **changes)).pipeline)
    names = {block.name for block in graph.blocks}
    assert present <= names
    assert not absent & names
    assert not any(name.startswith("solver") for name in names)


@pytest.mark.parametrize(
    ("shape", "text"),
    [
        (signed(17), "signed 17"),
        (unsigned(1), "1 bit"),
        (5, "unsigned 5"),
        (data.ArrayLayout(data.ArrayLayout(signed(3), 2), 4), "4 × 2 × signed 3"),
        (data.StructLayout({"u": signed(4), "seen": 1}), "u signed 4, seen 1 bit"),
    ],
    ids=str,
)
def test_words(shape, text):
    assert words_of(shape) == text
