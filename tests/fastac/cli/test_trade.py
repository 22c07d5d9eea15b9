from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext

import pytest
from command_line import fail, run, succeed

from fastac.scenes import schema as scenes
from fastac.sweep import pools


@pytest.fixture
def spec(toml, tmp_path):
    path = tmp_path / "spec.toml"
    quick = toml.read_text().replace("normals_epochs = 15", "normals_epochs = 1")
    toml.write_text(quick.replace("force_epochs = 5", "force_epochs = 1"))
    path.write_text('scene = "tiny.toml"\nframes = 2\n[axes]\n"numbers.data_bits" = [16, 26]\n')
    return path


def test_sweep_and_trade(spec, toml, tiny_file, tmp_path, monkeypatch):
    for name in pools.THREAD_VARIABLES:
        monkeypatch.setenv(name, "1")
    one_thread = pools.Pool(
        lambda: ThreadPoolExecutor(1), 1
    )  # processes take longer to start than this takes
    monkeypatch.setattr(pools, "local_pool", lambda workers: nullcontext(one_thread))
    spec.write_text(f'data = "{tiny_file}"\n{spec.read_text()}')
    results, page = tmp_path / "r.sqlite", tmp_path / "page"
    sweep = ("sweep", spec, "-o", results, "--store", tmp_path / "store", "--workers", 1, "--no-progress")
    assert succeed(*sweep).output == f"{results}: 2 done, 0 infeasible, 0 failed, 0 known\n"
    assert "2 known" in succeed(*sweep).output
    trade = ("trade", results, "-o", page, "--mark", toml, "--no-progress")
    found = succeed(*trade, "--pick", "depth_mae_mm<1, dsp<1000", "--by", "depth_mae_mm").output
    assert "The price of speed: depth error, mm" in found
    assert str(page / "trade.html") in found
    assert scenes.load(page / "picked.toml").numbers.data_bits in (16, 26)
    assert "scene tiny" in (page / "trade.html").read_text()
    assert "no such metric; there are" in fail(*trade, "--pick", "size<3")


def test_sweeps_that_cannot_start(spec, toml, tmp_path):
    assert "spec.toml: frame: unknown key" in fail("sweep", edited(spec, "frames", "frame"))
    assert (
        run("sweep", edited(spec, "frame =", "frames ="), "--workers", 1, "--scheduler", "x").exit_code == 2
    )
    toml.write_text(toml.read_text().replace('channels = "bgr+nir"', 'channels = "bgr"\nsource = "recorded"'))
    assert "spec.toml: data: missing: scene tiny is of a recorded sensor" in fail("sweep", spec)
    assert "no such file" in fail("trade", tmp_path / "none.sqlite")


def edited(path, old, new):
    path.write_text(path.read_text().replace(old, new))
    return path


def test_chips(toml):
    lines = succeed("chips", toml, "--rates", "60,240", "--clock-mhz", 50).output.splitlines()
    assert [cell.strip() for cell in lines[0].strip("|").split("|")][2:] == ["60 frames/s", "240 frames/s"]
    assert "At 50 MHz" in "\n".join(lines)
    refused = {"60,0": "expected positive numbers such as 60,240", "60,60": "a number is there twice"}
    for given, said in refused.items():
        assert f"{given!r}: {said}" in run("chips", toml, "--rates", given).stderr


def test_scope(toml, tmp_path):
    found = succeed("scope", toml, "--builds", tmp_path).output
    assert found.splitlines()[0].replace(" ", "") == "||tiny|"
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in found.splitlines()]
    assert ["force model", "kernels 5×5"] in rows
