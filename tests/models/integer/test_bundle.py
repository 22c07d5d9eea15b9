import json
import os
import shutil
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest

from fastac.models import random_bundle
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer import bundle
from fastac.models.integer.bundle import BundleError
from fastac.scenes.schema import Scene


@pytest.fixture
def folder(tiny_folder, tmp_path):
    """A copy of the trained bundle, to be damaged."""
    return shutil.copytree(tiny_folder / "bundle", tmp_path / "bundle")


def same(a, b, where: str = "pipeline") -> int:
    """Assert that two trees of dataclasses are equal bit for bit, types included; returns their arrays."""
    assert type(a) is type(b), where
    if isinstance(a, np.ndarray):
        assert a.dtype == b.dtype, where
        np.testing.assert_array_equal(a, b, err_msg=where)
        return 1
    if isinstance(a, Scene):
        assert a == b
        return 0
    if is_dataclass(a):
        return sum(same(getattr(a, f.name), getattr(b, f.name), f"{where}.{f.name}") for f in fields(a))
    if isinstance(a, tuple):
        assert len(a) == len(b), where
        return sum(same(x, y, f"{where}[{k}]") for k, (x, y) in enumerate(zip(a, b, strict=True)))
    assert a == b, where
    return 0


def sign(folder, content: dict) -> None:
    """Write a bundle's text with the hash of it and the folder's arrays, as whoever knows how may do."""
    everything = {}
    for name, prefix in (("integers", ""), ("floats", "float.")):
        with np.load(folder / f"{name}.npz") as archive:
            for key in archive.files:
                array = archive[key]
                wide = array.dtype.kind == "i" and not prefix
                everything[prefix + key] = array.astype(np.int64) if wide else array
    signed = content | {"sha256": bundle._digest(content, everything)}
    (folder / "bundle.json").write_text(json.dumps(signed))


def refused(folder, match: str) -> None:
    with pytest.raises(BundleError, match=match) as caught:
        bundle.load(folder)
    assert "\n" not in str(caught.value)
    assert str(folder) in str(caught.value)


class TestRoundTrip:
    def test_is_exact(self, tiny_bundle, tmp_path):
        written = bundle.save(tmp_path / "b", tiny_bundle.pipeline, tiny_bundle.floats)
        found = bundle.load(tmp_path / "b")
        assert same(tiny_bundle.pipeline, found.pipeline) > 20
        assert found.digest == written.digest == tiny_bundle.digest
        assert set(found.floats) == set(tiny_bundle.floats)
        for name, array in tiny_bundle.floats.items():
            assert array.dtype == found.floats[name].dtype
            np.testing.assert_array_equal(array, found.floats[name])
        assert found.scene == tiny_bundle.scene
        assert found.pipeline.provenance["source"].startswith("simulated")

    def test_an_interval_is_kept(self, tmp_path):
        scene = random_bundle.scene(("force_xyz",), solver="adjoint", coverage=0.9)
        written = random_bundle.random_bundle(tmp_path / "b", scene)
        assert written.pipeline.interval.weights.all()
        assert same(written.pipeline, bundle.load(tmp_path / "b").pipeline) > 15

    def test_without_an_interval_nothing_tells_of_it(self, tmp_path):
        """So bundles have the hash that they had before there were intervals."""
        random_bundle.random_bundle(tmp_path / "b", random_bundle.scene(("force_z",), solver="adjoint"))
        fields = json.loads((tmp_path / "b" / "bundle.json").read_text())["pipeline"]["fields"]
        assert "interval" not in fields
        assert "coverage" not in fields["scene"]["scene"]["force"]
        assert "normals_share" not in fields["scene"]["scene"]["training"]
        assert bundle.load(tmp_path / "b").pipeline.interval is None

    def test_without_squares_nothing_tells_of_them(self, tmp_path):
        settings = {"solver": "tridiagonal", "kernel": "collapsed", "band_mm": 0.002}
        made = random_bundle.scene(("force_xyz",), size=32, **settings)
        random_bundle.random_bundle(tmp_path / "b", made)
        content = json.loads((tmp_path / "b" / "bundle.json").read_text())["pipeline"]["fields"]
        assert not {"block_px", "cut_rows"} & content["force"]["fields"].keys()
        assert "block_px" not in content["scene"]["scene"]["force"]
        made = random_bundle.scene(("force_xyz",), size=32, block_px=4, **settings)
        random_bundle.random_bundle(tmp_path / "c", made)
        content = json.loads((tmp_path / "c" / "bundle.json").read_text())["pipeline"]["fields"]
        assert content["force"]["fields"]["block_px"] == 4
        assert bundle.load(tmp_path / "c").pipeline.force.block_px == 4

    def test_bundles_from_before_there_was_a_choice_round_to_the_nearest(self, tiny_bundle, folder):
        content = json.loads((folder / "bundle.json").read_text())
        del content["sha256"], content["pipeline"]["fields"]["scene"]["scene"]["numbers"]["rounding"]
        stages = content["pipeline"]["fields"]["solver"]["fields"]
        for name in ("row_forward", "column_forward", "division", "column_inverse", "row_inverse"):
            assert stages[name]["fields"].pop("rounding") == "nearest"
        sign(folder, content)
        assert same(bundle.load(folder).pipeline, tiny_bundle.pipeline) > 20

    def test_bundles_from_before_there_were_dots_have_none(self, tiny_bundle, folder):
        content = json.loads((folder / "bundle.json").read_text()) | {"format_version": 3}
        fields = content["pipeline"]["fields"]
        scene = fields["scene"]["scene"]
        absent = [fields.pop(name) for name in ("bridge", "follower", "dot_force")]
        absent += [fields["validity"]["fields"].pop("dots"), scene["force"].pop("band_mm")]
        absent += [scene["force"].pop("dots"), scene["network"].pop("bridge_dots")]
        assert not any(absent)
        del content["sha256"], scene["numbers"]["dot_weight_bits"]
        sign(folder, content)
        assert same(bundle.load(folder).pipeline, tiny_bundle.pipeline) > 20

    def test_dots_bridge_and_band_are_exact(self, tmp_path):
        settings = {"solver": "tridiagonal", "kernel": "collapsed", "band_mm": 0.002}
        scene = random_bundle.scene(("force_xyz",), dots=True, bridge_dots=True, **settings)
        written = random_bundle.random_bundle(tmp_path / "b", scene)
        found = bundle.load(tmp_path / "b")
        assert same(written.pipeline, found.pipeline) > 20
        for stage in ("bridge", "follower", "dot_force"):
            assert type(getattr(found.pipeline, stage)) is type(getattr(written.pipeline, stage))
        assert found.pipeline.validity.dots == 4
        assert found.pipeline.force.weight.shape == (3, 14, 14, 3)
        assert found.digest == written.digest
        reach = replace(written.pipeline.bridge, reach=written.pipeline.bridge.reach + 1)
        other = bundle.save(tmp_path / "other", written.pipeline.replace(bridge=reach), {})
        assert other.digest != written.digest

    def test_computes_the_same_after_it(self, tiny_bundle, tiny_data, tmp_path):
        bundle.save(tmp_path / "b", tiny_bundle.pipeline, tiny_bundle.floats)
        before = Emulator(tiny_bundle.pipeline).run(tiny_data.frames[:2])
        after = Emulator(bundle.load(tmp_path / "b").pipeline).run(tiny_data.frames[:2])
        for name, array in vars(before).items():
            np.testing.assert_array_equal(array, getattr(after, name))

    def test_stages_that_are_absent_stay_absent(self, tiny_bundle, tmp_path):
        empty = tiny_bundle.pipeline.replace(
            source=None, solver=None, depth=None, quantiser=None, force=None, force_n_per_unit=None
        )
        bundle.save(tmp_path / "b", empty, {})
        assert same(empty, bundle.load(tmp_path / "b").pipeline) > 5
        with np.load(tmp_path / "b" / "integers.npz") as archive:
            kept = {"layers", "background", "rest_depth_mm", "validity"}
            assert {name.split(".")[0] for name in archive.files} == kept

    @pytest.mark.parametrize(
        "largest", [127, 128, -128, -129, 32767, 32768, 2**31 - 1, 2**31, -(2**31), 2**40]
    )
    def test_tables_are_packed_without_loss(self, tiny_bundle, tmp_path, largest):
        pipeline = tiny_bundle.pipeline
        layer = replace(pipeline.layers[0], bias=np.array([largest] + [0] * 15), loadable=False)
        changed = pipeline.replace(layers=(layer, *pipeline.layers[1:]))
        bundle.save(tmp_path / "b", changed, {})
        assert bundle.load(tmp_path / "b").pipeline.layers[0].bias[0] == largest

    def test_the_hash_word_is_the_head_of_the_digest(self, tiny_bundle):
        assert len(tiny_bundle.digest) == 64
        assert f"{tiny_bundle.hash_word:016x}" == tiny_bundle.digest[:16]


class TestHash:
    def changed(self, tiny_bundle, tmp_path, pipeline=None, floats=None) -> bool:
        pipeline = tiny_bundle.pipeline if pipeline is None else pipeline
        floats = tiny_bundle.floats if floats is None else floats
        return bundle.save(tmp_path / "b", pipeline, floats).digest != tiny_bundle.digest

    def test_changes_with_any_integer(self, tiny_bundle, tmp_path):
        pipeline = tiny_bundle.pipeline
        kernel = pipeline.force.kernel.copy()
        kernel[0, 13, 13, 4, 4] ^= 1
        assert self.changed(
            tiny_bundle, tmp_path, pipeline.replace(force=replace(pipeline.force, kernel=kernel))
        )
        rest = pipeline.depth.rest.copy()
        rest[0, 0] += 1
        assert self.changed(tiny_bundle, tmp_path, pipeline.replace(depth=replace(pipeline.depth, rest=rest)))
        background = pipeline.background.copy()
        background[-1, -1, -1] ^= 1
        assert self.changed(tiny_bundle, tmp_path, pipeline.replace(background=background))

    def test_changes_with_any_scalar_setting_or_float(self, tiny_bundle, tmp_path, make_scene):
        pipeline = tiny_bundle.pipeline
        shift = replace(pipeline.quantiser, shift=pipeline.quantiser.shift + 1)
        assert self.changed(tiny_bundle, tmp_path, pipeline.replace(quantiser=shift))
        scene = make_scene(hardware={"clock_mhz": 151.0})
        assert self.changed(tiny_bundle, tmp_path, pipeline.replace(scene=scene))
        floats = dict(tiny_bundle.floats)
        floats["network.0.bias"] = np.nextafter(floats["network.0.bias"], np.float32(9))
        assert self.changed(tiny_bundle, tmp_path, floats=floats)
        floats = {k.replace("network.0.bias", "network.0.basis"): v for k, v in tiny_bundle.floats.items()}
        assert self.changed(tiny_bundle, tmp_path, floats=floats)

    def test_does_not_change_without_a_reason(self, tiny_bundle, tmp_path):
        turned = dict(reversed(tiny_bundle.floats.items()))
        fortran = tiny_bundle.pipeline.replace(background=np.asfortranarray(tiny_bundle.pipeline.background))
        assert not self.changed(tiny_bundle, tmp_path, fortran, turned)


class TestRefusals:
    def test_one_integer_was_changed(self, folder):
        with np.load(folder / "integers.npz") as archive:
            arrays = {k: archive[k] for k in archive.files}
        arrays["force.kernel"][0, 0, 0, 0, 0] ^= 1
        np.savez_compressed(folder / "integers.npz", **arrays)
        refused(folder, "sha256 = .*changed or damaged")

    @pytest.mark.parametrize(
        "change",
        [
            lambda content: content["pipeline"]["fields"].update(force_n_per_unit=1.0),
            lambda content: content["pipeline"]["fields"]["scene"]["scene"].update(name="other"),
            lambda content: content.update(sha256="0" * 64),
            lambda content: content.pop("sha256"),
        ],
    )
    def test_the_text_was_changed(self, folder, change):
        content = json.loads((folder / "bundle.json").read_text())
        change(content)
        (folder / "bundle.json").write_text(json.dumps(content))
        refused(folder, "sha256 = ")

    @pytest.mark.parametrize("name", ["bundle.json", "integers.npz", "floats.npz"])
    def test_a_file_is_missing(self, folder, name):
        (folder / name).unlink()
        refused(folder, f"{name}: no such file")

    def test_the_folder_is_missing(self, tmp_path):
        refused(tmp_path / "nowhere", "no such file; is .* a bundle folder")

    @pytest.mark.parametrize("version", [0, 2, 5, "3", None])
    def test_another_version(self, folder, version):
        content = json.loads((folder / "bundle.json").read_text())
        (folder / "bundle.json").write_text(json.dumps({**content, "format_version": version}))
        hint = {0: "; it was written by an older", 5: "; it was written by a newer"}.get(version, "")
        refused(folder, f"format_version = {version!r}: expected 3 or 4{hint}")

    @pytest.mark.parametrize("text", ["", "{", "[1]", "7", "\udcff"])
    def test_text_that_is_no_bundle(self, folder, text):
        (folder / "bundle.json").write_bytes(text.encode(errors="surrogateescape"))
        refused(folder, "not readable JSON|format_version = None")

    @pytest.mark.parametrize("name", ["integers.npz", "floats.npz"])
    def test_pickles_are_not_opened(self, folder, name, tmp_path):
        """An object array could run anything when it is unpickled."""

        class Bomb:
            def __reduce__(self):
                return (os.mkdir, (str(tmp_path / "exploded"),))

        bomb = np.empty(1, dtype=object)
        bomb[0] = Bomb()
        np.savez(folder / name, bomb=bomb)
        refused(folder, rf"{name}: damaged or no .npz file \(Object arrays cannot be loaded")
        assert not (tmp_path / "exploded").exists()

    @pytest.mark.parametrize("name", ["integers.npz", "floats.npz"])
    def test_damaged_archives(self, folder, name):
        """Every flipped bit and every cut is refused in one line, or harmless: in a time stamp, say."""
        whole = (folder / name).read_bytes()
        expected = bundle.load(folder).digest
        rng = np.random.default_rng(1)
        damaged = [whole[:cut] for cut in (0, 1, 100, len(whole) // 2, len(whole) - 1)]
        for position in rng.integers(0, len(whole), 100):
            content = bytearray(whole)
            content[position] ^= 1 << rng.integers(8)
            damaged.append(bytes(content))
        messages = []
        for content in damaged:
            (folder / name).write_bytes(content)
            try:
                found = bundle.load(folder)
            except BundleError as error:
                messages.append(str(error))
            else:
                assert found.digest == expected
        assert len(messages) > len(damaged) / 2
        assert not [message for message in messages if "\n" in message]

    @pytest.mark.parametrize("name", ["bundle.json", "integers.npz", "floats.npz"])
    def test_links_out_of_the_folder(self, folder, tmp_path, name):
        (folder / name).rename(tmp_path / "elsewhere")
        (folder / name).symlink_to("../elsewhere")
        refused(folder, f"'{name}': not a file inside this folder")

    @pytest.mark.parametrize("text", ["[" * 100_000, "9" * 5000, '{"format_version": ' + "8" * 4000 + "}"])
    def test_json_that_cannot_be_read(self, folder, text):
        (folder / "bundle.json").write_text(text)
        refused(folder, r"bundle\.json: (not readable JSON|format_version = 8{200}…: expected)")

    def test_a_hash_of_several_lines(self, folder):
        content = json.loads((folder / "bundle.json").read_text())
        (folder / "bundle.json").write_text(json.dumps(content | {"sha256": "a\nb"}))
        refused(folder, r"sha256 = 'a\\nb': the content's is")

    def test_an_array_instead_of_an_archive(self, folder):
        with (folder / "floats.npz").open("wb") as file:
            np.save(file, np.zeros(3))
        refused(folder, "floats.npz: damaged or no .npz file")

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            (lambda fields: fields["scene"]["scene"].update(colour="red"), "scene: colour: unknown key"),
            (lambda fields: fields["ratio"].update({"class": "Popen"}), "KeyError.*Popen"),
            (lambda fields: fields["ratio"]["fields"].pop("width"), "TypeError"),
            (lambda fields: fields["background"].update(array="nothing"), "KeyError.*nothing"),
            (lambda fields: fields["depth"]["fields"].update(mode="relative"), "ValueError.*mode 'relative'"),
        ],
    )
    def test_what_has_the_right_hash_but_no_meaning(self, folder, change, message):
        """As a later version might write, or somebody who knows how the hash is made."""
        content = json.loads((folder / "bundle.json").read_text())
        change(content["pipeline"]["fields"])
        del content["sha256"]
        sign(folder, content)
        refused(folder, message)


class TestSave:
    def test_replaces_an_older_bundle(self, tiny_bundle, folder):
        (folder / "stale").touch()
        changed = tiny_bundle.pipeline.replace(force_n_per_unit=2.0)
        bundle.save(folder, changed, {})
        found = bundle.load(folder)
        assert found.pipeline.force_n_per_unit == 2.0
        assert found.floats == {}
        assert sorted(path.name for path in folder.iterdir()) == ["bundle.json", "floats.npz", "integers.npz"]
        assert [path.name for path in folder.parent.iterdir()] == ["bundle"]

    def test_keeps_the_older_one_if_it_fails(self, tiny_bundle, folder, monkeypatch):
        def full(*_, **__):
            raise OSError("no space left on device")

        monkeypatch.setattr(np, "savez_compressed", full)
        with pytest.raises(OSError, match="no space left"):
            bundle.save(folder, tiny_bundle.pipeline.replace(force_n_per_unit=2.0), {})
        monkeypatch.undo()
        assert bundle.load(folder).digest == tiny_bundle.digest
        assert [path.name for path in folder.parent.iterdir()] == ["bundle"]  # and no rubbish

    def test_makes_the_folders_above(self, tiny_bundle, tmp_path):
        bundle.save(tmp_path / "a" / "b" / "c", tiny_bundle.pipeline, {})
        assert bundle.load(tmp_path / "a" / "b" / "c").digest
        assert (tmp_path / "a" / "b" / "c").stat().st_mode & 0o777 == 0o755

    def test_nothing_is_pickled(self, tiny_folder):
        for name in ("integers.npz", "floats.npz"):
            with np.load(tiny_folder / "bundle" / name, allow_pickle=False) as archive:
                for key in archive.files:
                    assert archive[key].dtype != object
        assert sorted(p.name for p in (tiny_folder / "bundle").iterdir()) == [
            "bundle.json",
            "floats.npz",
            "integers.npz",
        ]
