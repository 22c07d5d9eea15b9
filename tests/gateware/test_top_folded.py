"""The top level at fewer than one pixel a clock: the same integers, and cycles by formula."""

import pytest
from top_hardware import Hardware, check_frames

DESIGNS = {
    "patches": {"outputs": ("depth", "force_z", "force_map"), "lanes": "1/2", "mode": "absolute"},
    "slopes": {"outputs": ("force_xyz",), "solver": "adjoint", "lanes": "1/8", "clamp": False},
    "collapsed": {
        "outputs": ("normals", "depth", "force_xyz"),
        "solver": "tridiagonal",
        "kernel": "collapsed",
        "lanes": "1/16",
        "mode": "difference",
        "clamp": False,
    },
    "dots": {
        "outputs": ("force_xyz",),
        "solver": "adjoint",
        "lanes": "1/4",
        "dots": True,
        "bridge_dots": True,
        "size": 32,
        "clamp": False,
    },
    "baked": {
        "outputs": ("depth", "force_xyz"),
        "kernel": "collapsed",
        "lanes": "1/4",
        "weights": "baked",
        "channels": "bgr+nir",
        "clamp": False,
    },
    "slip": {
        "outputs": ("depth", "force_x", "force_z", "slip"),
        "channels": "bgr+nir",
        "solver": "tridiagonal",
        "kernel": "collapsed",
        "lanes": "1/8",
        "mode": "difference",
        "size": 24,
        "dots": True,
        "band_mm": 0.001,
        "deep_mm": (0.003, 0.006),
        "block_px": 4,
    },
    "interval and levelled light": {
        "outputs": ("depth", "force_xyz"),
        "solver": "tridiagonal",
        "source": "slopes",
        "lanes": "1/2",
        "weights": "baked",
        "mode": "difference",
        "coverage": 0.9,
        "level_light": True,
    },
    "baked slopes": {
        "outputs": ("force_xyz",),
        "solver": "adjoint",
        "lanes": "1/16",
        "weights": "baked",
        "block_px": 2,
    },
    "baked patches": {"outputs": ("depth", "force_xyz"), "lanes": "1/16", "weights": "baked"},
    "floor": {
        "outputs": ("depth", "force_z"),
        "size": 17,
        "lanes": "1/8",
        "rounding": "floor",
        "divergence": "backward",
        "kernel_size": 5,
    },
}
LONG = ("collapsed",)
"""What `make test` runs; the others only `make test-all`."""


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=pytest.mark.long if n in LONG else pytest.mark.full) for n in DESIGNS],
)
def test_frames(tmp_path, name):
    hardware = Hardware(tmp_path, **DESIGNS[name])
    assert hardware.top.datapath.fold > 1
    check_frames(hardware)
