"""Figures of the demonstrations over time: spectra and forces of a vibration, and the course of a grasp."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from fastac.report.figures import save_png
from fastac.studies.demos.grip_control import friction_ratio
from fastac.studies.demos.records import GraspTrace, PipelineOutput, VibrationRecording

SHOWN_S = 0.12
"""Duration of the forces that the vibration figure shows."""
HIGHEST_RATIO = 2.5
"""Upper end of the axis of μ, in multiples of the coefficient of friction."""


def vibration(
    shown: list[tuple[VibrationRecording, dict[str, PipelineOutput]]], path: Path, scene: str
) -> None:
    """A column per frequency; a row of spectra per pipeline, then a row of forces over time per pipeline."""
    names = list(shown[0][1])
    size = {"figsize": (4.2 * len(shown), 3.2 * len(names)), "sharex": "row", "sharey": "row"}
    figure, grid = plt.subplots(2 * len(names), len(shown), squeeze=False, layout="constrained", **size)
    middle_s = shown[0][0].camera_s[-1] / 2
    for column, (recording, pipelines) in zip(grid.T, shown, strict=True):
        for k, name in enumerate(names):
            output, colour = pipelines[name], f"C{k}"
            above, below = column[k], column[len(names) + k]
            bins = output.spectrum
            above.axvline(recording.frequency_hz, color="0.6", linestyle="--", linewidth=0.9)
            above.plot(bins.frequency_hz[1:], bins.amplitude[1:], color=colour, linewidth=1)
            above.plot(bins.peak_hz, bins.amplitude[1:].max(), "o", color=colour, markersize=4)
            below.plot(recording.fine_s, recording.fine_force_n, color="0.7", linewidth=0.9)
            below.plot(output.output_s, output.force_n, "o-", color=colour, markersize=3, linewidth=1)
            rate = f"{recording.frequency_hz} Hz, {name} at {output.rate_hz:.0f} Hz"
            above.set_title(f"{rate}: {bins.peak_hz:.1f} Hz", fontsize=9)
            below.set_title(rate, fontsize=9)
            above.set_xlim(0, 125)
            below.set_xlim(middle_s, middle_s + SHOWN_S)
        column[len(names) - 1].set_xlabel("frequency, Hz")
        column[-1].set_xlabel("time, s")
    for k, row in enumerate(grid):
        row[0].set_ylabel("amplitude, N" if k < len(names) else "F_z, N")
    figure.suptitle(
        f"{scene}: F_z of the integer model; dashed: the vibration's frequency; grey: true force; simulated"
    )
    save_png(figure, path)


def grasp(traces: dict[str, GraspTrace], content: dict, path: Path) -> None:
    """Forces, μ, angle and the bottle's displacement over time, a column per run; `content` is grasp.json's.

    Where the runs tell of slip, also the spread of the dots in contact and the share of nodes that stick.
    """
    slip = "limit_px" in content
    labels = ["force of a finger, N", "μ = F_s / F_n", "Δθ, °", "downwards, mm"]
    labels += ["spread, px", "nodes that stick, %"] if slip else []
    size = {"figsize": (5.2 * len(traces), 2.25 * len(labels)), "sharex": True, "sharey": "row"}
    figure, grid = plt.subplots(len(labels), len(traces), **size)
    limit, friction = content["stable_ratio"] + content["margin"], content["friction"]
    for k, (column, (name, trace)) in enumerate(zip(grid.T, traces.items(), strict=True)):
        forces, ratios, angle, displacement = column[:4]
        for kind, force_n, line in (("found", trace.found_force_n, "-"), ("true", trace.true_force_n, ":")):
            forces.plot(trace.time_s, force_n[:, 2], "C0", linestyle=line, linewidth=1, label=f"F_n {kind}")
            shear_n = np.hypot(force_n[:, 0], force_n[:, 1])
            forces.plot(trace.time_s, shear_n, "C3", linestyle=line, linewidth=1, label=f"F_s {kind}")
        ratios.plot(trace.time_s, friction_ratio(trace.found_force_n), color="C2", linewidth=1, label="found")
        ratios.plot(trace.time_s, friction_ratio(trace.true_force_n), "k:", linewidth=0.8, label="true")
        ratios.axhline(limit, color="C1", linestyle="--", linewidth=0.9, label="μ_s + d")
        ratios.axhline(friction, color="0.5", linestyle="-.", linewidth=0.9, label="friction")
        angle.plot(trace.time_s, -trace.tightened_deg, color="C4", linewidth=1.2)
        displacement.plot(
            trace.time_s, trace.lowered_mm, color="0.4", linewidth=1, label="bottle's displacement"
        )
        displacement.plot(trace.time_s, trace.slipped_mm, color="C3", linewidth=1.4, label="of which slip")
        if trace.slip is not None:
            spread, sticking = column[4:]
            spread.plot(trace.time_s, trace.slip.slip_px, color="C5", linewidth=1)
            spread.axhline(content["limit_px"], color="C1", linestyle="--", linewidth=0.9)
            sticking.plot(trace.time_s, 100 * trace.slip.sticking, color="0.4", linewidth=1)
        forces.set_title(f"({'abc'[k]}) {name.replace('_', ' ')}", fontsize=10)
        sliding = np.flatnonzero(np.diff(trace.slipped_mm, prepend=0) > 0)
        for panel in column:
            for start in sliding[np.diff(sliding, prepend=-2) > 1] if len(sliding) else ():
                panel.axvline(trace.time_s[start], color="k", linestyle="--", linewidth=0.7)
        column[-1].set_xlabel("time, s")
    for row, label in zip(grid, labels, strict=True):
        row[0].set_ylabel(label)
    for row in (0, 1, 3):
        grid[row, 0].legend(loc="upper left", fontsize=7)
    grid[1, 0].set_ylim(0, HIGHEST_RATIO * friction)
    figure.suptitle(
        f"{content['scene']}: bottle pushed down; dashed black: slip begins; simulated", fontsize=9
    )
    figure.tight_layout(rect=(0, 0, 1, 0.99))
    save_png(figure, path)
