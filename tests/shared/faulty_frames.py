"""Faulty frames through the whole IP core: what is flagged, repaired and counted."""

import json
from itertools import product

import numpy as np
from top_hardware import MILD, NAME, Hardware

from fastac.models.emulator.pipeline import Emulator
from fastac.models.result import concatenate
from fastac.sim.check_top import SLIP, bench_settings, expected_words
from fastac.sim.runner import QUICK, build

SHORT_ROWS = 7
"""Rows of the image with the fault "frame_short"."""


def repaired(image: np.ndarray, fault: str, lanes: int) -> np.ndarray:
    """The image that FrameGuard makes of one with a fault of `faulty`: padded with the last pixel."""
    image = image.copy()
    if fault == "line_short":
        image[5, 3 * lanes :] = image[5, 3 * lanes - 1]
    elif fault == "line_short, the last":
        image[-1, lanes:] = image[-1, lanes - 1]
    elif fault.startswith("frame_short"):
        image[SHORT_ROWS:] = image[SHORT_ROWS - 1, -1]
    return image


def faulty(number: int, fault: str, height: int, line: int) -> list[list[int]]:
    """The lines (image, row, beats, tlast, tuser) of an image with a fault."""
    lines = [[number, row, line, 1, int(row == 0)] for row in range(height)]
    if fault == "line_short":
        lines[5][2] = 3
    elif fault == "line_short, the last":
        lines[-1][2] = 1
    elif fault == "line_long":
        lines[4][2] += 2
    elif fault == "line_long, no end":
        lines[4][3] = 0
    elif fault == "frame_short":
        lines = lines[:SHORT_ROWS]
    elif fault == "frame_long":
        lines += [[number, 0, line, 1, 0]] * 3
    elif fault == "no_start":
        lines = [[number, 0, line, 1, 0]] * 2
    return lines


def check_faults(hardware: Hardware) -> None:
    """Faulty input, resets and the host's controls; see sim/benches/top_faults.py."""
    pipeline, lanes = hardware.pipeline, hardware.top.lanes
    height, width, _ = pipeline.background.shape
    mild = list(hardware.frames(*MILD))
    images, scenarios = list(mild), {}

    def lines(number: int, fault: str = "") -> list[list[int]]:
        return faulty(number, fault, height, width // lanes)

    faults = ("line_short", "line_short, the last", "line_long", "line_long, no end", "frame_short")
    for fault in (*faults, "frame_long", "no_start"):
        kind = fault.split(",")[0]
        scenario = {"errors": [kind]}
        if kind == "no_start":
            scenario |= {"lines": lines(0, fault) + lines(1), "frames": [1], "bad": [0]}
        elif kind == "frame_long":
            scenario |= {"lines": lines(0, fault) + lines(1), "frames": [0, 1], "bad": [0, 0]}
        else:
            if fault == "line_long, no end":  # the next line is dropped, so the frame is too short
                scenario["errors"] = ["line_long", "frame_short"]
                images.append(np.concatenate([mild[1][:5], mild[1][6:], mild[1][-1:]]))
                images[-1][-1] = images[-1][-2, -1]
            else:
                images.append(repaired(mild[1], fault, lanes))
            twice = [len(images) - 1] * 2
            scenario |= {
                "lines": lines(0) + lines(1, fault) * 2 + lines(2) + lines(3),
                "frames": [0, *twice, 2, 3],
                "bad": [0, 1, 1, 0, 0],
            }
        scenarios[fault.replace(", ", "_").replace(" ", "_")] = scenario

    background = len(images)
    images.append(pipeline.background)
    images += list(hardware.frames(255, 60, 80, 40))
    # Extreme values in a corner pixel, which the solver does not use, to saturate slopes only.
    for values in product((0, 255), repeat=pipeline.background.shape[-1]):
        images.append(pipeline.background.copy())
        images[-1][0, 0] = values
    images = np.array(images)
    results = [Emulator(pipeline).run(images)]
    of_scene = {
        "gradient_saturated": pipeline.scene.wants_slopes,
        "displacement_saturated": pipeline.scene.force_from_displacement,
    }
    errors = [
        tuple(name for name, wanted in of_scene.items() if wanted and getattr(results[0], name)[k])
        + ("frame_suspect",) * bool(results[0].validity[k])
        for k in range(len(images))
    ]
    assert not any(errors[: len(MILD)])
    for scenario in scenarios.values():
        scenario["errors"] += {name for k in scenario["frames"] for name in errors[k]}
    saturating = {kinds: k for k, kinds in enumerate(errors) if kinds}
    if all(of_scene.values()):
        kinds = {tuple(name for name in names if name != "frame_suspect") for names in saturating} - {()}
        assert len(kinds) == 3, f"{list(saturating)}: one of each kind and both are wanted"
    assert any("frame_suspect" in kinds for kinds in saturating)

    # The following frames have the second frame as their background.
    captured = len(images)
    images = np.concatenate([images, mild[1:4]])
    results.append(Emulator(pipeline.replace(background=mild[1])).run(np.array(mild[1:4])))
    assert not results[1].gradient_saturated.any()
    assert not results[1].validity.any()
    result = concatenate(results)
    archive = {"frames": images, "validity": result.validity, **expected_words(hardware.top, result)}
    if pipeline.scene.wants_force:
        archive["force"] = result.force_raw
    if pipeline.interval is not None:
        archive["half_widths"] = result.force_half_width_raw
    if pipeline.scene.wants_slip:
        words = dict(zip(SLIP, (result.slip_words, result.slip_dots), strict=True))
        archive |= words | {"slipping": result.slipping}
    folder = hardware.folder / "faults"
    folder.mkdir()
    np.savez(folder / "frames.npz", **archive)
    settings = bench_settings(hardware.top) | {
        "timeout_cycles": 20_000,
        "row_order": next((o.row_order for o in hardware.top.outputs if o.tagged), None),
        "scenarios": scenarios,
        "short_rows": SHORT_ROWS,
        "background": background,
        "captured": captured,
        "after_capture": [captured + 1, captured + 2],
        "saturating": [[k, list(errors)] for errors, k in saturating.items()],
    }
    (folder / "settings.json").write_text(json.dumps(settings))
    runner = build(hardware.source, NAME, hardware.folder / "sim" / "build", build_args=QUICK)
    runner.test(
        hdl_toplevel=NAME,
        test_module="fastac.sim.benches.top_faults",
        build_dir=hardware.folder / "sim" / "build",
        extra_env={"BENCH": str(folder)},
    )
