"""A file of Rerun is read back: every frame, its time stamps, forces, depths, pictures, surface and flags."""

import socket
from dataclasses import replace

import numpy as np
import pytest

from fastac.streaming.session import open_session
from fastac.streaming.views.pictures import Sight, colours_of_normals, rest_depth_mm, triangles
from fastac.streaming.views.rerun_recording import ViewError
from fastac.streaming.views.rerun_view import logged, shown

rerun = pytest.importorskip("rerun")
FRAMES = 6


@pytest.fixture(scope="module")
def played(tiny_folder, tiny_file, tmp_path_factory):
    """The records, what is known of the sensor, and the file."""
    path = tmp_path_factory.mktemp("rerun") / "tiny.rrd"
    with open_session(tiny_folder, str(tiny_file), frames_per_second=50) as session:
        records = list(session.records(frames=FRAMES))
        sight = Sight(session.about, rest_depth_mm(session.bundle))
    records[3] = replace(records[3], suspect=True, reasons=("change",), errors=("overflow",))
    records[4] = replace(records[4], lost=True, force_n={}, arrays={"image": records[4].image})
    sink = logged(sight, path)
    for record in records:
        sink.add(record)
    sink.close()
    assert (sink.taken, sink.left_out) == (FRAMES, 0)
    return records, sight, path


@pytest.fixture(scope="module")
def columns(played):
    """`columns(entity, component)`: {frame: value}; frame None: what does not change."""
    from rerun.chunk import RrdReader

    batches = [(chunk.entity_path, chunk.to_record_batch()) for chunk in RrdReader(str(played[2])).stream()]

    def of(entity: str, component: str, index: str = "frame") -> dict:
        found = {}
        for path, batch in batches:
            if path == entity and component in batch.schema.names:
                values = batch.column(component)
                known = index in batch.schema.names
                keys = batch.column(index).to_pylist() if known else [None] * len(values)
                found |= {
                    key: value.as_py() for key, value in zip(keys, values, strict=True) if value.is_valid
                }
        return dict(sorted(found.items(), key=lambda item: str(item[0])))

    return of


def test_forces_latencies_and_time_stamps_of_every_frame(played, columns):
    records, _, _ = played
    forces = columns("/plots/force_n", "Scalars:scalars")
    assert forces == {r.frame: pytest.approx(list(r.force_n.values())) for r in records if not r.lost}
    host = columns("/plots/latency_ms/host", "Scalars:scalars")
    assert host == {r.frame: pytest.approx([1e3 * r.timing.host_latency_s]) for r in records if not r.lost}
    times = columns("/plots/force_n", "Scalars:scalars", "source_time")
    assert [time.total_seconds() for time in times] == [0.0, 0.02, 0.04, 0.06, 0.1]


def test_depths_in_mm(played, columns):
    records, _, _ = played
    depths = columns("/depth", "DepthImage:buffer")
    assert list(depths) == [r.frame for r in records if not r.lost]
    for frame, (octets,) in depths.items():
        depth = np.array(octets, np.uint8).view(np.float32).reshape(14, 14)
        np.testing.assert_array_equal(depth, records[frame].depth_mm)
    assert columns("/depth", "DepthImage:meter")[None] == [1000.0]


def test_pictures(played, columns):
    records, _, _ = played
    images = columns("/camera/image", "Image:buffer")
    assert list(images) == list(range(FRAMES))  # a lost frame was seen all the same
    for frame, (octets,) in images.items():
        np.testing.assert_array_equal(
            np.array(octets, np.uint8).reshape(16, 16, 3), records[frame].image[..., :3]
        )
    assert columns("/camera/image", "Image:format")[None][0]["color_model"] == rerun.ColorModel.BGR.value
    (nir,) = columns("/camera/nir", "Image:buffer")[2]
    np.testing.assert_array_equal(np.array(nir, np.uint8).reshape(16, 16), records[2].image[..., 3])
    (normals,) = columns("/normals", "Image:buffer")[2]
    np.testing.assert_array_equal(
        np.array(normals, np.uint8).reshape(16, 16, 3), colours_of_normals(records[2].normals)
    )


def test_the_surface_is_the_depth_in_mm(played, columns):
    records, sight, _ = played
    for frame, places in columns("/skin/surface", "Mesh3D:vertex_positions").items():
        places = np.array(places).reshape(14, 14, 3)
        np.testing.assert_array_equal(places[..., 2], records[frame].depth_mm)
        np.testing.assert_array_equal(places[5, :, 0], sight.x_mm)
        np.testing.assert_array_equal(places[:, 5, 1], sight.y_mm)
    fixed = columns("/skin/surface", "Mesh3D:triangle_indices")[None]
    np.testing.assert_array_equal(fixed, triangles(14, 14))
    (arrow,) = columns("/skin/force", "Arrows3D:vectors")[1]
    assert arrow[2] < 0


def test_flags(played, columns):
    states = columns("/status", "StateChange:state")
    assert states == {0: ["ok"], 3: ["suspect: change"], 4: ["lost"], 5: ["ok"]}
    events = columns("/events", "TextLog:text")
    assert events == {3: ["frame 3: suspect: change; error overflow"], 4: ["frame 4: lost"]}


def test_the_layout_names_what_is_there(played):
    from rerun.chunk import RrdReader

    reader = RrdReader(str(played[2]))
    chunks = [chunk for entry in reader.blueprints() for chunk in reader.stream(store=entry)]
    batches = [chunk.to_record_batch() for chunk in chunks]
    key = "ViewBlueprint:display_name"
    names = [row[0] for b in batches if key in b.schema.names for row in b.column(key).to_pylist() if row]
    assert {"Camera, near infrared", "Normals", "Skin, mm", "Force, N", "Flagged frames"} <= set(names)
    assert not [name for name in names if name.startswith("Force map")]


def test_a_file_that_cannot_be_written(played, tmp_path):
    with pytest.raises(ViewError, match=r"none/a\.rrd: "):
        logged(played[1], tmp_path / "none" / "a.rrd")


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("rerun+http://127.0.0.1:{port}/proxy", "no Rerun viewer answers"),
        ("nonsense", "expected an address such as"),
        ("rerun+http://127.0.0.1:none/proxy", "expected an address such as"),
    ],
)
def test_no_viewer_at_an_address(played, url, message):
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(ViewError, match=message):
        shown(played[1], url.format(port=port))


def test_no_viewer_where_there_is_no_display(played, monkeypatch):
    monkeypatch.setattr("fastac.streaming.views.rerun_view.display", lambda: False)
    with pytest.raises(ViewError, match="no display here"):
        shown(played[1])


def test_without_rerun_a_line_says_how_to_install_it(played, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "rerun", None)
    with pytest.raises(ViewError, match=r"pip install -e '\.\[view\]'"):
        logged(played[1], tmp_path / "a.rrd")
