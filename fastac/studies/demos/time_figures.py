"""The pictures of the experiments in time: spectra and forces of a vibration, and a grasp frame by frame."""

from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from fastac.report.figures import save_png
from fastac.studies.demos.grip_control import friction_ratio

if TYPE_CHECKING:
    from fastac.studies.demos.records import Recording, Seen, Trace

SHOWN_S = 0.12
"""Of a vibration's forces."""
HIGHEST_RATIO = 2.5
"""Of μ, in terms of the friction."""


def vibration(shown: list[tuple["Recording", dict[str, "Seen"]]], path: Path, scene: str) -> None:
    """A column for each frequency: spectra above, forces in time below; a row of each for every pipeline."""
    names = list(shown[0][1])
    size = {"figsize": (4.2 * len(shown), 3.2 * len(names)), "sharex": "row", "sharey": "row"}
    figure, grid = plt.subplots(2 * len(names), len(shown), squeeze=False, layout="constrained", **size)
    middle_s = shown[0][0].camera_s[-1] / 2
    for column, (recording, pipelines) in zip(grid.T, shown, strict=True):
        for k, name in enumerate(names):
            seen, colour = pipelines[name], f"C{k}"
            above, below = column[k], column[len(names) + k]
            bins = seen.spectrum
            above.axvline(recording.frequency_hz, color="0.6", linestyle="--", linewidth=0.9)
            above.plot(bins.frequency_hz[1:], bins.amplitude[1:], color=colour, linewidth=1)
            above.plot(bins.peak_hz, bins.amplitude[1:].max(), "o", color=colour, markersize=4)
            below.plot(recording.fine_s, recording.fine_n, color="0.7", linewidth=0.9)
            below.plot(seen.output_s, seen.force_n, "o-", color=colour, markersize=3, linewidth=1)
            rate = f"{recording.frequency_hz} Hz, {name} at {seen.rate_hz:.0f} Hz"
            above.set_title(f"{rate}: {bins.peak_hz:.1f} Hz", fontsize=9)
            below.set_title(rate, fontsize=9)
            above.set_xlim(0, 125)
            below.set_xlim(middle_s, middle_s + SHOWN_S)
        column[len(names) - 1].set_xlabel("frequency, Hz")
        column[-1].set_xlabel("time, s")
    for k, row in enumerate(grid):
        row[0].set_ylabel("amplitude, N" if k < len(names) else "F_z, N")
    figure.suptitle(f"{scene}: F_z of the integers; dashed: the input; grey: the true force; simulated")
    save_png(figure, path)


def grasp(traces: dict[str, "Trace"], content: dict, path: Path) -> None:
    """Forces, μ, angle and the bottle's way against time, without feedback and with it."""
    figure, grid = plt.subplots(4, len(traces), figsize=(5.2 * len(traces), 9), sharex=True, sharey="row")
    limit, friction = content["stable_ratio"] + content["margin"], content["friction"]
    for k, (column, (name, trace)) in enumerate(zip(grid.T, traces.items(), strict=True)):
        forces, ratios, angle, way = column
        for kind, force_n, line in (("found", trace.found_n, "-"), ("true", trace.true_n, ":")):
            forces.plot(trace.time_s, force_n[:, 2], "C0", linestyle=line, linewidth=1, label=f"F_n {kind}")
            shear_n = np.hypot(force_n[:, 0], force_n[:, 1])
            forces.plot(trace.time_s, shear_n, "C3", linestyle=line, linewidth=1, label=f"F_s {kind}")
        ratios.plot(trace.time_s, friction_ratio(trace.found_n), color="C2", linewidth=1, label="found")
        ratios.plot(trace.time_s, friction_ratio(trace.true_n), "k:", linewidth=0.8, label="true")
        ratios.axhline(limit, color="C1", linestyle="--", linewidth=0.9, label="μ_s + d")
        ratios.axhline(friction, color="0.5", linestyle="-.", linewidth=0.9, label="friction")
        angle.plot(trace.time_s, -trace.tightened_deg, color="C4", linewidth=1.2)
        way.plot(trace.time_s, trace.lowered_mm, color="0.4", linewidth=1, label="bottle's way")
        way.plot(trace.time_s, trace.slipped_mm, color="C3", linewidth=1.4, label="of it slip")
        forces.set_title(f"({'ab'[k]}) {name.replace('_', ' ')}", fontsize=10)
        sliding = np.flatnonzero(np.diff(trace.slipped_mm, prepend=0) > 0)
        for panel in column:
            for start in sliding[np.diff(sliding, prepend=-2) > 1] if len(sliding) else ():
                panel.axvline(trace.time_s[start], color="k", linestyle="--", linewidth=0.7)
        way.set_xlabel("time, s")
    labels = ("force of a finger, N", "μ = F_s / F_n", "Δθ, °", "down, mm")
    for row, label in zip(grid, labels, strict=True):
        row[0].set_ylabel(label)
    for row in (0, 1, 3):
        grid[row, 0].legend(loc="upper left", fontsize=7)
    grid[1, 0].set_ylim(0, HIGHEST_RATIO * friction)
    figure.suptitle(f"{content['scene']}: bottle pushed down; black: slip begins; simulated", fontsize=9)
    figure.tight_layout(rect=(0, 0, 1, 0.99))
    save_png(figure, path)
