# amaranth: UnusedElaboratable=no
"""SAIF and FST traces of the top level, and the compressors of sim/fst that replace system libraries."""

import re
import subprocess
import zlib
from itertools import pairwise

import lz4.block
import numpy as np
import pytest
from pywellen import Waveform

from fastac.gateware.target.elaboration import to_verilog
from fastac.gateware.top_zynq import TopZynq
from fastac.models.emulator.pipeline import Emulator
from fastac.models.random_bundle import frames, random_bundle, scene
from fastac.sim.check_top import bench_settings, simulate, trace_file
from fastac.sim.runner import COMPRESSORS, QUICK

NAME = "fastac"


DRIVER = r"""
#include <cstdio>
#include <iostream>
#include <iterator>
#include <string>
#include <lz4.h>
#include <zlib.h>
int main(int, char** argv) {
    const std::string in((std::istreambuf_iterator<char>(std::cin)), {});
    std::string out;
    if (argv[1][0] == 'l') {
        out.resize(LZ4_compressBound(in.size()));
        out.resize(LZ4_compress_default(in.data(), &out[0], in.size(), out.size()));
    } else {
        uLongf size = compressBound(in.size());
        out.resize(size);
        const auto* source = reinterpret_cast<const Bytef*>(in.data());
        if (compress2(reinterpret_cast<Bytef*>(&out[0]), &size, source, in.size(), 9) != Z_OK) return 1;
        out.resize(size);
    }
    std::fwrite(out.data(), 1, out.size(), stdout);
}
"""


@pytest.fixture(scope="module")
def compress(tmp_path_factory):
    folder = tmp_path_factory.mktemp("compressors")
    (folder / "driver.cpp").write_text(DRIVER)
    command = ["c++", "-std=c++14", "-Wall", "-Wextra", "-Werror", "-fsanitize=undefined", f"-I{COMPRESSORS}"]
    subprocess.run([*command, "-o", folder / "driver", folder / "driver.cpp"], check=True)
    return lambda kind, data: (
        subprocess.run([folder / "driver", kind], input=data, capture_output=True, check=True).stdout
    )


def _samples() -> list[bytes]:
    rng = np.random.default_rng(1)
    noise = rng.integers(0, 256, 70_000).astype(np.uint8).tobytes()
    return [
        *(noise[:n] for n in (0, 1, 4, 11, 12, 13, 14, 15, 16, 269, 270, 271)),
        noise,
        bytes(200_000),
        b"m_axis_depth_tdata" * 9,
        noise + noise,  # beyond the farthest match
        noise[:60_000] * 2,
        rng.integers(0, 3, 5_000).astype(np.uint8).tobytes(),
    ]


@pytest.mark.parametrize("data", _samples(), ids=lambda data: f"{len(data)} bytes")
def test_compressors(compress, data):
    packed = compress("lz4", data)
    assert lz4.block.decompress(packed, uncompressed_size=len(data)) == data
    assert zlib.decompress(compress("zlib", data)) == data


def test_repetitive_data_is_compressed(compress):
    assert len(compress("lz4", bytes(200_000))) < 1000
    assert len(compress("lz4", b"m_axis_depth_tdata" * 9)) < 40


@pytest.fixture(scope="module")
def traced(tmp_path_factory):
    """Function that simulates one frame with a trace; returns (trace file, report, clock period in ps)."""
    folder = tmp_path_factory.mktemp("traced")
    bundle = random_bundle(folder / "bundle", scene(("normals",)))
    top = TopZynq(bundle)
    source = folder / f"{NAME}.v"
    source.write_text(to_verilog(top, name=NAME))
    images = frames(bundle.pipeline.background, (40,))
    result = Emulator(bundle.pipeline).run(images)

    def run(trace):
        report = simulate(
            bundle, source, images, result, folder / "sim", name=NAME, build_args=QUICK, trace=trace
        )
        assert (report.frames, report.mismatches) == (1, 0)
        assert report.values_compared == 16 * 16 * 3
        return trace_file(folder / "sim", NAME, trace), report, bench_settings(top)["period_ps"]

    return run


def saif_instances(text: str) -> tuple[dict, dict]:
    """Parse a SAIF file: {instance path: {net: {T0, T1, TC}}}, and the fields of its header."""
    tokens = re.findall(r'"[^"]*"|[()]|[^\s()]+', re.sub(r"^//.*$", "", text, flags=re.MULTILINE))
    stack, found = [[]], {}
    for token in tokens:
        if token == "(":
            stack.append([])
        elif token == ")":
            stack[-2].append(stack.pop())
        else:
            stack[-1].append(token)
    ((root,),) = stack
    assert root[0] == "SAIFILE"

    def walk(node, path):
        nets = found.setdefault("/".join(path), {})
        for part in node:
            if isinstance(part, list) and part[0] == "NET":
                nets.update({net[0]: {k: int(v) for k, v in net[1:]} for net in part[1:]})
            elif isinstance(part, list) and part[0] == "INSTANCE":
                walk(part[2:], [*path, part[1]])

    walk(root[1:], [])
    fields = {part[0]: part[1:] for part in root[1:] if isinstance(part, list) and part[0] != "INSTANCE"}
    return found, fields


@pytest.mark.full
def test_saif(traced):
    """The content that Vivado's report_power reads: every net's time high and low, and its toggle count."""
    file, report, period_ps = traced("saif")
    instances, fields = saif_instances(file.read_text())
    (duration,) = (int(v) for v in fields["DURATION"])
    assert fields["TIMESCALE"] == ["1ps"]
    clocks = duration / period_ps
    assert (
        report.cycles < clocks < report.cycles + 150
    )  # beside the frame: reset, identity check and idle clocks
    top = instances[NAME]
    assert abs(top["clk"]["TC"] - 2 * clocks) <= 2
    assert abs(top["clk"]["T1"] / duration - 0.5) < 0.01
    for path, nets in instances.items():
        for net, activity in nets.items():
            assert activity["T0"] + activity["T1"] == duration, (path, net)
            assert activity["TC"] <= top["clk"]["TC"], (path, net)
    assert f"{NAME}/datapath/mlp" in instances
    # 256 beats were accepted, one per clock; their data toggled at most once per beat.
    assert top["s_axis_tvalid"]["T1"] == 256 * period_ps
    assert top["s_axis_tvalid"]["TC"] == 2
    busy = [top[rf"s_axis_tdata\[{bit}\]"]["TC"] for bit in range(24)]
    assert all(64 < count <= 256 for count in busy)


@pytest.mark.full
def test_fst(traced):
    """Read by another program than the one that wrote it."""
    file, report, period_ps = traced("fst")
    wave = Waveform(str(file), multi_threaded=False)
    assert (wave.timescale.factor, wave.timescale.unit.to_exponent()) == (1, -12)
    found = {var.full_name: var for var in wave.all_vars()}
    assert f"{NAME}.datapath.mlp.o__valid" in found
    assert found[f"{NAME}.s_axis_tdata"].bitwidth == 24
    clock = found[f"{NAME}.clk"].tv[:]
    assert {later - earlier for (earlier, _), (later, _) in pairwise(clock)} == {period_ps // 2}
    assert report.cycles < clock[-1][0] / period_ps < report.cycles + 150
    # 256 beats were accepted one a clock.
    (_, low), (begins, high), (ends, again) = found[f"{NAME}.s_axis_tvalid"].tv[:]
    assert (low, high, again, ends - begins) == (0, 1, 0, 256 * period_ps)


@pytest.mark.full
def test_traced_simulators_have_their_own_build_folder(traced, tmp_path):
    file, *_ = traced("saif")
    assert (file.parent / "build-saif" / NAME).exists()
    assert not (file.parent / "build").exists()
