from command_line import fail, succeed

from fastac.sensor import dataset


class TestData:
    def test_writes_the_dataset_and_says_that_it_is_simulated(self, toml, tmp_path, one_process, tiny_data):
        toml.write_text(toml.read_text().replace("train_grid = 3", "train_grid = 1"))
        result = succeed("data", toml, "-o", tmp_path / "new" / "d.h5", "--no-progress")
        assert "simulated" in result.stdout
        data = dataset.read(tmp_path / "new" / "d.h5")
        assert data.channels == ("B", "G", "R", "NIR")
        assert len(data) == 2 * (1 + 4 + 4)
        assert data.pitch_mm == 0.25

    def test_says_how_many_samples_friction_could_not_carry(self, toml, tmp_path, one_process):
        text = (
            toml.read_text().replace('"force_z"]', '"force_xyz"]').replace("train_grid = 3", "train_grid = 1")
        )
        gel = 'thickness_mm = 2.0, mechanics = "fem", friction = 0.6, elements = 8, layers = 1 }'
        toml.write_text(text.replace("thickness_mm = 2.0 }", gel))
        store = tmp_path / "store"
        result = succeed("data", toml, "-o", tmp_path / "d.h5", "--store", store, "--no-progress")
        data = dataset.read(tmp_path / "d.h5")
        assert (
            f"{len(data)} samples; {data.left_out} left out, whose load the contact could not carry"
            in result.stdout
        )
        assert len(data) + data.left_out == 2 * (1 + 4 + 4) * 9
        assert len([*store.rglob("compliance.npy")]) == 1

    def test_goes_to_the_build_folder_of_the_scene(self, toml, tmp_path, monkeypatch, one_process):
        monkeypatch.chdir(tmp_path)
        succeed("data", toml, "--no-progress")
        assert (tmp_path / "build" / "tiny" / "data.h5").exists()

    def test_errors(self, toml, tmp_path, one_process):
        text = toml.read_text()
        assert fail("data", tmp_path / "no.toml") == f"{tmp_path}/no.toml: No such file or directory"
        toml.write_text(text.replace("pitch_mm", "pitch"))
        assert fail("data", toml) == f"{toml}: sensor.pitch: unknown key; did you mean pitch_mm?"
        toml.write_text(text.replace("width_px = 16", "width_px = sixteen"))
        assert fail("data", toml).startswith(f"{toml}: Invalid value (at line")
        toml.write_text(text.replace("height_px = 16", "height_px = 24"))
        assert fail("data", toml).startswith(f"{toml}: sensor.height_px: 24 differs from width_px 16")
        toml.write_text(text.replace("ball_mm = 1.5", "ball_mm = 15.0"))
        assert fail("data", toml).startswith("protocol.ball_mm = 15: no room for it")
        toml.write_text(text.replace("[protocol]", 'source = "recorded"\n[protocol]'))
        assert "sensor.source = 'recorded': expected 'simulated'" in fail("data", toml)
