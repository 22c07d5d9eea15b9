"""A vibrating ball on the virtual sensor, sampled by pipelines of different output rates: the paper's figure.

The ball's position is a sine; its force is not quite one. A camera of 240 Hz records it, and the bundle's
integer model computes F_z of every frame. A pipeline of a given output rate processes only the frames that
it accepts while it is not busy (fastac/studies/demos/sampling.py). The spectrum treats its outputs as evenly
spaced at their mean rate, as a reader of the output would. Everything is simulated. The paper states the
rates of its platforms; this design's follows from its cycles.
"""

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

from fastac.flow import frames
from fastac.gateware.cycle_model import cycles
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer import bundle as bundles
from fastac.models.integer.bundle import Bundle
from fastac.report.tables import Table
from fastac.scenes.schema import Scene
from fastac.sensor.fingertip import require_simulated
from fastac.sensor.mechanics.press import Rig
from fastac.sensor.mechanics.rig import probe_of, rig_of
from fastac.sensor.protocol import FingertipError
from fastac.store.files import write_json
from fastac.store.progress import progress_bar
from fastac.studies.demos.records import PipelineOutput, VibrationRecording
from fastac.studies.demos.sampling import CAMERA_HZ, accepted_frames, alias_hz, spectrum

FREQUENCIES_HZ = (50, 70, 100)
PAPER_HZ = {"CPU": 104, "GPU": 156, "FPGA": 240}
"""Output rates of the paper's platforms (supplement, section III)."""
PAPER_RECOVERS = {"CPU": (50,), "GPU": (50, 70), "FPGA": (50, 70, 100)}
"""Vibrations in Hz that each platform reproduces without aliasing (same section)."""
THIS_DESIGN = "this design"
LOADS = 9
"""Simulated presses from which the load at each position of the ball is interpolated."""


@dataclass(frozen=True)
class Vibration:
    """Parameters of the ball's motion.

    A load of None becomes a share of the largest load in the scene's protocol (1.5 N in the paper).
    """

    seconds: float = 1.0
    mean_n: float | None = None
    """Mean load; default: 2/3 of the largest load."""
    amplitude_n: float | None = None
    """Half the difference of the loads at the two ends of the motion; default: 4/15 of the largest load."""

    def ends_n(self, scene: Scene) -> tuple[float, float]:
        """The smallest and the largest load. Raises FingertipError unless 0 < amplitude < mean."""
        largest = max(scene.protocol.loads_n)
        mean = 2 / 3 * largest if self.mean_n is None else self.mean_n
        amplitude = 4 / 15 * largest if self.amplitude_n is None else self.amplitude_n
        if not 0 < amplitude < mean < np.inf:
            raise FingertipError(f"load {mean:g} N ± {amplitude:g} N: expected 0 < amplitude < mean")
        return mean - amplitude, mean + amplitude


def service_s(scene: Scene) -> dict[str, Fraction]:
    """Seconds that each pipeline is busy with a frame: the inverse rate of the paper's platforms, and the
    initiation interval at the scene's clock of this design."""
    clock_hz = Fraction(scene.hardware.clock_mhz) * 10**6
    ours = Fraction(cycles(scene)["initiation_interval"]) / clock_hz
    return {**{name: Fraction(1, rate) for name, rate in PAPER_HZ.items()}, THIS_DESIGN: ours}


def record(
    bundle: Bundle, rig: Rig, vibration: Vibration, frequency_hz: int, *, progress: bool
) -> VibrationRecording:
    """Camera frames of a vibration in the middle of the skin, with true F_z and F_z of the integer model.

    Raises ContactError where a load exceeds what the gel can carry.
    """
    scene = bundle.scene
    ball_mm, (least, most) = scene.protocol.ball_mm, vibration.ends_n(scene)
    probe, loads_n = probe_of(rig, ball_mm, 0.0, 0.0), np.linspace(least, most, LOADS)
    approach_mm = np.array([probe.at_load(load).pose["approach_mm"] for load in loads_n])
    load_at = PchipInterpolator(approach_mm, loads_n)

    def load_n(time_s: np.ndarray) -> np.ndarray:
        swing = np.sin(2 * np.pi * frequency_hz * time_s)
        middle, half = (approach_mm[-1] + approach_mm[0]) / 2, (approach_mm[-1] - approach_mm[0]) / 2
        return load_at(np.clip(middle + half * swing, approach_mm[0], approach_mm[-1]))

    count = round(vibration.seconds * CAMERA_HZ)
    camera_s = np.arange(count) / CAMERA_HZ
    rng = np.random.default_rng(scene.protocol.seed)
    images, true_force_n = [], []
    label = f"{frequency_hz} Hz"
    for load in progress_bar(load_n(camera_s), desc=label, unit="frame", enabled=progress):
        pressed = probe.at_load(float(load))
        true_force_n.append(pressed.force_n[2])
        images.append(frames.of_press(pressed, scene.sensor, rng))
    found = Emulator(bundle.pipeline).run(np.stack(images), wanted=("force_n",), progress=progress).force_n
    fine_s = np.arange(0, count / CAMERA_HZ, 1 / (40 * frequency_hz))
    found_force_n = found[:, scene.force_axes.index(2)]
    return VibrationRecording(
        frequency_hz, camera_s, np.array(true_force_n), found_force_n, fine_s, load_n(fine_s)
    )


def pipeline_output(recording: VibrationRecording, service_s: Fraction) -> PipelineOutput:
    """The outputs of a pipeline that is busy with each frame for `service_s` seconds."""
    index, starts = accepted_frames(Fraction(CAMERA_HZ), service_s, len(recording.found_force_n))
    output_s = np.array([float(start + service_s) for start in starts])
    rate_hz = (len(starts) - 1) / float(starts[-1] - starts[0])
    force_n = recording.found_force_n[index]
    sine = np.sin(2 * np.pi * recording.frequency_hz * recording.camera_s[index])
    expected_hz = spectrum(sine, rate_hz).peak_hz
    return PipelineOutput(output_s, force_n, rate_hz, spectrum(force_n, rate_hz), expected_hz)


def evaluate(recording: VibrationRecording, output: PipelineOutput) -> dict:
    """Dominant frequency, expected and found, and whether the vibration was recovered, to within one bin.

    `alias_hz` assumes even sampling. Dropped frames make it uneven, which adds images about the camera's
    rate: at 104 outputs a second 100 Hz appears at 4 Hz and, from 240 − 100 Hz, at 36 Hz. Which one is larger
    depends on the phase; `expected_hz` is that one.
    """
    frequency, found = output.spectrum, output.spectrum.peak_hz
    bin_hz = frequency.resolution_hz * (1 + 1e-9)
    return {
        "outputs": len(output.force_n),
        "dropped_frames": len(recording.found_force_n) - len(output.force_n),
        "mean_output_hz": output.rate_hz,
        "resolution_hz": frequency.resolution_hz,
        "alias_hz": alias_hz(alias_hz(recording.frequency_hz, CAMERA_HZ), output.rate_hz),
        "expected_hz": output.expected_hz,
        "found_hz": found,
        "amplitude_n": float(frequency.amplitude[1:].max()),
        "as_expected": abs(found - output.expected_hz) <= bin_hz,
        "recovered": abs(found - recording.frequency_hz) <= bin_hz,
    }


def run(
    bundle: Bundle,
    folder: Path,
    *,
    vibration: Vibration | None = None,
    store: Path = frames.STORE,
    progress: bool = True,
) -> dict:
    """Record and evaluate all frequencies; write vibration.json and vibration.png into `folder`; return the
    JSON's content.

    Raises FingertipError for a scene that is recorded or has no F_z, ContactError where a load exceeds what
    the gel can carry.
    """
    from fastac.studies.demos import time_figures

    scene, vibration = bundle.scene, vibration or Vibration()
    require_simulated(scene, "vibration", (2,))
    ends_n, services = vibration.ends_n(scene), service_s(scene)
    slowest = max(services.values())
    if not 8 * slowest <= vibration.seconds <= 60:
        raise FingertipError(f"seconds = {vibration.seconds:g}: expected {float(8 * slowest):.2g} to 60")
    rig = rig_of(scene.sensor, store, progress=progress)
    shown, found = [], {}
    for frequency_hz in FREQUENCIES_HZ:
        recording = record(bundle, rig, vibration, frequency_hz, progress=progress)
        outputs = {name: pipeline_output(recording, service_s) for name, service_s in services.items()}
        shown.append((recording, outputs))
        error = recording.found_force_n - recording.true_force_n
        found[str(frequency_hz)] = {
            "force_error_n": {"mean": float(error.mean()), "mean_absolute": float(np.abs(error).mean())},
            "pipelines": {name: evaluate(recording, output) for name, output in outputs.items()},
            "true_force_z_n": recording.true_force_n.tolist(),
            "found_force_z_n": recording.found_force_n.tolist(),
        }
    fastest_hz = float(1 / services[THIS_DESIGN])
    content = {
        "source": "simulated",
        "scene": scene.name,
        "bundle": bundle.digest,
        "vibration": {"seconds": vibration.seconds, "least_n": ends_n[0], "most_n": ends_n[1]},
        "camera_hz": CAMERA_HZ,
        "busy_ms_per_frame": {name: float(1000 * service) for name, service in services.items()},
        "projected": {
            "origin": "estimated: hardware.clock_mhz / initiation interval; needs a camera as fast",
            "output_hz": fastest_hz,
            "bandwidth_hz": fastest_hz / 2,
        },
        "frequencies": found,
    }
    folder.mkdir(parents=True, exist_ok=True)
    time_figures.vibration(shown, folder / "vibration.png", scene.name)
    write_json(folder / "vibration.json", content)
    return content


def section(folder: Path, scene: Scene, bundle: Path, *, store: Path, progress: bool) -> None:
    """A step: the experiment as a section of the reproduction."""
    run(bundles.load_for(bundle, scene), folder, store=store, progress=progress)


def lacks(scene: Scene) -> str | None:
    """One line that says why the scene does not allow this experiment; None if it does."""
    try:
        require_simulated(scene, "vibration", (2,))
    except FingertipError as error:
        return str(error)
    return None


def tables(content: dict) -> list[Table]:
    """Dominant frequency per vibration and pipeline beside the paper's, from vibration.json's content."""
    rows, keys = [], ("mean_output_hz", "alias_hz", "expected_hz", "found_hz")
    for frequency, found in content["frequencies"].items():
        for name, output in found["pipelines"].items():
            verdict = "recovered" if output["recovered"] else "aliased" if output["as_expected"] else "wrong"
            paper = PAPER_RECOVERS.get(name)
            rows.append(
                [
                    f"{frequency} Hz",
                    name,
                    *(f"{output[key]:.1f}" for key in keys),
                    verdict,
                    "" if paper is None else "recovered" if int(frequency) in paper else "aliased",
                ]
            )
    errors = [found["force_error_n"]["mean_absolute"] for found in content["frequencies"].values()]
    projected = content["projected"]["output_hz"]
    return [
        Table(
            "Dominant frequency of F_z(t)",
            ["input", "pipeline", "outputs, Hz", "alias, Hz", "expected, Hz", "found, Hz", "ours", "paper"],
            rows,
            f"F_z of the integer model: mean absolute error {1000 * np.mean(errors):.1f} mN, simulated."
            f" With as fast a camera, this design gives {projected:,.0f} forces a second (estimated: clock"
            " / interval).",
        )
    ]
