import shutil

import pytest
from command_line import fail, succeed

from fastac.flow import verify
from fastac.models.integer import bundle as bundles
from fastac.sensor import dataset

VERIFIED = {
    "pixels_per_clock": 2,
    "weights": "baked",
    "note": "",
    "stalls": False,
    "frames": 7,
    "values_compared": 50,
    "mismatches": 0,
    "first_mismatch": "",
    "cycles": 99,
}


class TestVerify:
    @pytest.fixture
    def campaign(self, monkeypatch):
        """What `fastac verify` asks for; the campaign itself has tests of its own."""
        given = {}

        def run(bundle, data, index, paces, folder, *, store, progress):
            given.update(
                digest=bundles.load_bundle(bundle).digest, index=index.tolist(), paces=paces, folder=folder
            )
            return {"rows": [VERIFIED | given.get("row", {})]}

        monkeypatch.setattr(verify, "run", run)
        return given

    def test_campaign(self, tiny_folder, tiny_file, tiny_bundle, campaign):
        options = ("--data", tiny_file, "--lanes", "2,1", "--frames", 3, "--split", "test", "--no-progress")
        result = succeed("verify", tiny_folder, *options)
        assert campaign["digest"] == tiny_bundle.digest
        assert campaign["paces"] == (2, 1)
        assert len(campaign["index"]) == 3
        assert set(campaign["index"]) <= set(dataset.read(tiny_file).indices("test"))
        assert campaign["folder"] == tiny_folder / "verify"
        lines = result.stdout.splitlines()
        assert lines[0].split()[:2] == ["px/clock", "weights"]
        assert lines[1].split() == ["2", "baked", "7", "50", "0", "99"]
        assert lines[2] == str(tiny_folder / "verify" / "verify.json")

    def test_campaign_that_finds_something(self, tiny_folder, tiny_file, campaign, tmp_path):
        campaign["row"] = {"mismatches": 3, "first_mismatch": "depth: value 7"}
        message = fail("verify", tiny_folder, "--data", tiny_file, "-o", tmp_path)
        assert message == "3 mismatches; depth: value 7"
        assert campaign["paces"] == (1, 2, 4)

    def test_campaign_of_a_scene_builds_its_bundle(self, campaign, monkeypatch, tmp_path, tiny_folder, toml):
        """In the build folder, whose dataset then serves."""
        monkeypatch.chdir(tmp_path)
        built = []

        def build(scene, folder, data, progress, until):
            built.append((scene.name, until))
            shutil.copytree(tiny_folder, folder)

        monkeypatch.setattr("fastac.cli.verify.run_build", build)
        message = fail("verify", toml)
        assert built == [("tiny", "bundle")]
        assert message.startswith("build/tiny/data.h5: ")
        assert campaign == {}
