"""Folders with a report.json as finished builds have it, for what compares them."""

import json
from copy import deepcopy
from pathlib import Path

REPORT = {
    "scene": {
        "name": "one",
        "outputs": ["depth", "force_z"],
        "sensor": {"height_px": 16, "width_px": 16, "markers": None},
        "protocol": {"seed": 1, "loads_n": [0.1, 0.2]},
        "poisson": {"solver": "dst2d"},
        "hardware": {"pixels_per_clock": 1, "clock_mhz": 150.0},
    },
    "bundle_sha256": "ab" * 32,
    "data": {"source": "simulated: seed 1", "test_frames": 8},
    "frames_are": "simulated",
    "latency_cycles": {
        "stage": {"normals": 59, "depth": 500, "force": 41},
        "first_pixel_to_force": 600,
        "last_pixel_to_force": 345,
        "initiation_interval": 256,
        "origin": "counted",
    },
    "latency_cycles_by_formula": {"stage": {"normals": 59, "gradients": 1, "source": 499, "force": 41}},
    "rtl_vs_integer": {"frames": 2, "values_compared": 394, "mismatches": 0},
    "accuracy": {
        "float": {"depth_mae_mm": 0.02, "force_mae_n": 0.05, "force_r2": 0.9},
        "integer": {"depth_mae_mm": 0.025, "force_mae_n": 0.04, "force_r2": 0.95},
    },
    "resources": {
        "dsp48e2": {"value": 200, "origin": "estimated: x"},
        "dsp48e2_by_module": {"value": {"normals": 150, "depth": 50}, "origin": "estimated: x"},
    },
    "energy_estimate_uj_per_frame": {"value": 2.0, "origin": "estimated: x"},
}


def build(folder: Path, **changes) -> Path:
    """A folder with a report; `changes` are its keys, with __ between a key and one inside it."""
    content = deepcopy(REPORT)
    for keys, value in changes.items():
        *outer, last = keys.split("__")
        place = content
        for key in outer:
            place = place[key]
        place[last] = value
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "report.json").write_text(json.dumps(content))
    return folder


FASTER = {
    "scene__name": "two",
    "scene__poisson": {"solver": "tridiagonal"},
    "scene__hardware__pixels_per_clock": 2,
    "latency_cycles__first_pixel_to_force": 150,
    "accuracy__integer": {"depth_mae_mm": 0.03, "force_mae_n": 0.04, "force_r2": 0.99},
    "resources__dsp48e2": {"value": 10, "origin": "estimated: x"},
    "rtl_vs_integer__mismatches": 3,
}
