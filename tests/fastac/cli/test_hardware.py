import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import fail, succeed

from fastac.flow import hardware
from fastac.models.integer import bundle as bundles
from fastac.sim.check_top import Report as Simulated


class TestHardware:
    """As far as it goes without elaborating: the rest is tested with the gateware and the simulation."""

    def test_no_bundle_no_verilog(self, tmp_path):
        message = fail("verilog", tmp_path)
        assert "is a bundle folder?" in message.replace(f"{tmp_path} a", "a")
        assert not (tmp_path / "verilog").exists()

    def test_calibration_of_a_network_that_was_trained_anew(self, tiny_folder, tiny_bundle, tmp_path):
        pipeline = tiny_bundle.pipeline
        first = replace(pipeline.layers[0], bias=pipeline.layers[0].bias + 1)
        changed = pipeline.replace(layers=(first, *pipeline.layers[1:]))
        bundles.save(tmp_path / "new", changed, tiny_bundle.floats)
        output = tmp_path / "folder" / "new.bin"
        printed = succeed("calibration", tmp_path / "new", "--for", tiny_folder, "-o", output).output
        words = np.fromfile(output, "<u4")
        digest = bundles.load(tmp_path / "new").digest
        stated = f"{output}: {len(words)} words, layout {words[0]:#010x}, sha256 {digest}"
        assert printed.strip() == stated
        assert f"{words[-1]:08x}{words[-2]:08x}" == digest[:16]
        assert list(output.parent.iterdir()) == [output]

    def test_registers_for_other_tools(self, tiny_folder, tmp_path):
        printed = succeed("registers", tiny_folder, "-o", tmp_path / "registers").output
        names = ["fastac_registers.h", "fastac.svd", "fastac.rdl", "registers.md", "fastac.dtso"]
        assert printed.strip() == f"{tmp_path / 'registers'}: {', '.join(names)}"
        assert sorted(file.name for file in (tmp_path / "registers").iterdir()) == sorted(names)
        header = (tmp_path / "registers" / "fastac_registers.h").read_text()
        assert header.startswith("/* tiny: registers")
        assert "FASTAC_FORCE_Z_N_PER_LSB" in header

    def test_calibration_that_does_not_fit(self, tiny_folder, tiny_bundle, tmp_path):
        pipeline = tiny_bundle.pipeline
        force = replace(pipeline.force, kernel=-pipeline.force.kernel)
        bundles.save(tmp_path / "new", pipeline.replace(force=force, force_n_per_unit=None), {})
        message = fail("calibration", tmp_path / "new", "--for", tiny_folder, "-o", tmp_path / "new.bin")
        assert message.startswith("force.kernel: ")
        assert not (tmp_path / "new.bin").exists()
        # Unless the hardware's kernels are kept; what results is a bundle like any other.
        arguments = ("--for", tiny_folder, "-o", tmp_path / "new.bin", "--keep-force", tmp_path / "kept")
        succeed("calibration", tmp_path / "new", *arguments)
        kept, words = bundles.load(tmp_path / "kept"), np.fromfile(tmp_path / "new.bin", "<u4")
        assert f"{words[-1]:08x}{words[-2]:08x}" == kept.digest[:16]
        np.testing.assert_array_equal(kept.pipeline.force.kernel, pipeline.force.kernel)
        np.testing.assert_array_equal(kept.pipeline.force_n_per_unit, pipeline.force_n_per_unit)

    def test_no_verilog_no_simulation(self, tiny_folder, tiny_file, tmp_path):
        message = fail("sim", tiny_folder, "--data", tiny_file, "--verilog", tmp_path)
        assert message.startswith(f"{tmp_path}/hardware.json: ")
        assert message.endswith("no Verilog was written here")

    def test_verilog_of_another_bundle(self, tiny_folder, tiny_file, tmp_path):
        (tmp_path / "hardware.json").write_text(json.dumps({"bundle_sha256": "0" * 64}))
        message = fail("sim", tiny_folder, "--data", tiny_file, "--verilog", tmp_path)
        assert message.startswith(f"{tmp_path}: bundle_sha256 = {'0' * 16}…: the bundle's is ")

    @pytest.mark.parametrize(
        ("options", "frames", "trace"),
        [
            ((), 3, None),
            (("--trace", "saif"), 1, "saif"),
            (("--trace", "fst", "--frames", "2"), 2, "fst"),
        ],
    )
    def test_traces_are_of_one_frame_unless_told(
        self, tiny_folder, tiny_file, tiny_bundle, tmp_path, monkeypatch, options, frames, trace
    ):
        """What reaches the simulator; its traces are tested with it."""
        given = {}

        def simulate(bundle, source, images, result, folder, **settings):
            given.update(settings, frames=len(images), results=len(result.normals))
            return Simulated(len(images), 1, 0, "", {}, 0, 1)

        monkeypatch.setattr(hardware.simulation, "simulate", simulate)
        (tmp_path / "hardware.json").write_text(json.dumps({"bundle_sha256": tiny_bundle.digest}))
        arguments = ("--data", tiny_file, "--verilog", tmp_path, "-o", tmp_path / "sim", *options)
        result = succeed("sim", tiny_folder, *arguments)
        assert (given["frames"], given["results"], given["trace"]) == (frames, frames, trace)
        last = result.stdout.splitlines()[-1]
        assert last == (f"{tmp_path}/sim/fastac.{trace}" if trace else "}")
