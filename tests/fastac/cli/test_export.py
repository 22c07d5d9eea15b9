import sys

import numpy as np
import pytest
from command_line import fail, succeed

import fastac
from fastac.models import random_bundle
from fastac.models.integer import bundle as bundles


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("export") / "b"
    random_bundle.random_bundle(path, random_bundle.scene(("normals", "depth", "force_z")))
    return path


@pytest.fixture(scope="module")
def single(folder):
    path = folder.with_suffix(".fastac")
    succeed("export", "bundle", folder, "-o", path, "--licence", "CC0-1.0")
    return path


class TestBundle:
    def test_says_what_it_wrote_and_replaces_nothing(self, folder, tmp_path):
        path = tmp_path / "a.fastac"
        digest = bundles.load(folder).digest
        assert succeed("export", "bundle", folder, "-o", path).stdout == (
            f"{path}: 0.02 MB, sha256 of the bundle {digest}\n"
        )
        assert fail("export", "bundle", folder, "-o", path) == f"{path}: exists already; --force replaces it"
        succeed("export", "bundle", folder, "-o", path, "--force")

    def test_python_opens_it(self, folder, single):
        frame = bundles.load(folder).pipeline.background
        found, known = (fastac.load(path).run(frame) for path in (single, folder))
        np.testing.assert_array_equal(found.depth_mm, known.depth_mm)
        np.testing.assert_array_equal(found.force_n, known.force_n)

    def test_commands_take_it(self, folder, single):
        """And write beside it what they write into a folder."""
        of_file, of_folder = (succeed("registers", path) for path in (single, folder))
        assert of_file.stdout.startswith(f"{single.parent}/b-files/registers: ")
        assert of_folder.stdout.startswith(f"{folder}/registers: ")

    def test_card(self, folder, single):
        text = succeed("card", single).stdout
        assert text.startswith("# random_bundle\n")
        assert "| CC0-1.0 " in text
        assert succeed("card", folder).stdout.splitlines()[:2] == text.splitlines()[:2]

    def test_a_damaged_one_is_one_line(self, single, tmp_path):
        content = bytearray(single.read_bytes())
        content[content.rindex(b"integers.npz", 0, len(content) // 2 * 2 - 200) + 200] ^= 1
        path = tmp_path / "a.fastac"
        path.write_bytes(content)
        assert fail("card", path).startswith(f"{path}: ")


class TestOnnx:
    @pytest.fixture(autouse=True)
    def _extra(self):
        pytest.importorskip("onnx")
        pytest.importorskip("onnxruntime")

    def test_writes_and_checks(self, single, tmp_path):
        path = tmp_path / "m.onnx"
        text = succeed("export", "onnx", single, "-o", path).stdout
        assert "values equal" in text
        assert "force, N" in text
        import onnxruntime

        session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
        frame = bundles.load(single).pipeline.background[None]
        (force_n,) = session.run(["force_n"], {"frame": frame})
        np.testing.assert_array_equal(force_n[0], fastac.load(single).run(frame[0]).force_n)
        assert fail("export", "onnx", single, "-o", path) == f"{path}: exists already; --force replaces it"

    def test_both_arithmetics_of_trained_models(self, tiny_folder, tmp_path):
        path = tmp_path / "m.onnx"
        text = succeed("export", "onnx", tiny_folder, "-o", path, "--arithmetic", "both").stdout
        assert "float_depth_mm" in text
        assert "float models under onnxruntime" in text

    def test_no_float_models(self, folder, tmp_path):
        message = fail("export", "onnx", folder, "-o", tmp_path / "m.onnx", "--arithmetic", "float")
        assert message == "scene random_bundle: the bundle has no float models; use --arithmetic integer"

    def test_a_value_that_differs_is_an_error(self, folder, tmp_path, monkeypatch):
        from fastac.export import integer_graph

        monkeypatch.setattr(integer_graph, "FLOOR", "nearest")
        message = fail("export", "onnx", folder, "-o", tmp_path / "m.onnx")
        assert "values under onnxruntime" in message
        assert "differ from the integers" in message
        assert not (tmp_path / "m.onnx").exists()

    @pytest.mark.parametrize("command", [("export", "onnx", "{}", "-o", "{}.onnx"), ("bench", "onnx", "{}")])
    @pytest.mark.parametrize("missing", ["onnx", "onnxruntime"])
    def test_without_the_extra(self, folder, monkeypatch, command, missing):
        monkeypatch.setitem(sys.modules, missing, None)
        message = fail(*(word.format(folder) for word in command))
        assert message == f"{missing} is not installed: run pip install -e '.[onnx]'"

    def test_bench(self, folder, monkeypatch):
        from fastac.studies.benchmarks import onnx_runtime

        monkeypatch.setattr(onnx_runtime, "FRAMES", 2)
        monkeypatch.setattr(onnx_runtime, "REPEATS", 1)
        text = succeed("bench", "onnx", folder).stdout
        assert "ONNX, a frame a call" in text
        assert text.splitlines()[-1].startswith("ONNX = emulator: ")
