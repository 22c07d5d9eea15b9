"""A vibrating ball on the virtual sensor, seen by pipelines of different output rates: the paper's figure.

The ball moves up and down as a sine, so that the force is not quite one. A camera of 240 Hz sees it, the
bundle's integers find F_z in every frame, and a pipeline of a given output rate has those frames that it
takes while it is not busy (fastac/studies/demos/sampling.py). Its outputs are then taken as even at their mean rate, as
whoever reads them would. All of it is simulated. The paper's rates are stated, this design's follows from
its cycles.
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
from fastac.studies.demos.records import Recording, Seen
from fastac.studies.demos.sampling import CAMERA_HZ, alias_hz, spectrum, taken

FREQUENCIES_HZ = (50, 70, 100)
PAPER_HZ = {"CPU": 104, "GPU": 156, "FPGA": 240}
"""Output rates of the paper's platforms (supplement, section III)."""
PAPER_RECOVERS = {"CPU": (50,), "GPU": (50, 70), "FPGA": (50, 70, 100)}
"""Vibrations in Hz that each of them shows at their own frequency (the same section)."""
OURS = "this design"
LOADS = 9
"""Presses from which the load at each place of the motion is interpolated."""


@dataclass(frozen=True)
class Vibration:
    """What the ball does. Loads not given are shares of the scene's largest, the paper's 1.5 N."""

    seconds: float = 1.0
    mean_n: float | None = None
    """Two thirds of the largest load."""
    amplitude_n: float | None = None
    """Four fifteenths of the largest load: half of what lies between the motion's ends."""

    def ends_n(self, scene: Scene) -> tuple[float, float]:
        """The smallest and the largest load. Raises FingertipError where they cannot be."""
        largest = max(scene.protocol.loads_n)
        mean = 2 / 3 * largest if self.mean_n is None else self.mean_n
        amplitude = 4 / 15 * largest if self.amplitude_n is None else self.amplitude_n
        if not 0 < amplitude < mean < np.inf:
            raise FingertipError(f"load {mean:g} N ± {amplitude:g} N: expected 0 < amplitude < mean")
        return mean - amplitude, mean + amplitude


def service_s(scene: Scene) -> dict[str, Fraction]:
    """How long each pipeline is busy with a frame: the paper's by their rates, this design by its cycles."""
    clock_hz = Fraction(scene.hardware.clock_mhz) * 10**6
    ours = Fraction(cycles(scene)["initiation_interval"]) / clock_hz
    return {**{name: Fraction(1, rate) for name, rate in PAPER_HZ.items()}, OURS: ours}


def record(bundle: Bundle, rig: Rig, vibration: Vibration, frequency_hz: int, *, progress: bool) -> Recording:
    """Frames of one frequency, in the middle of the skin, and the forces found in them.

    Raises ContactError for a load that is too much.
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
    images, true_n = [], []
    label = f"{frequency_hz} Hz"
    for load in progress_bar(load_n(camera_s), desc=label, unit="frame", enabled=progress):
        pressed = probe.at_load(float(load))
        true_n.append(pressed.force_n[2])
        images.append(frames.of_press(pressed, scene.sensor, rng))
    found = Emulator(bundle.pipeline).run(np.stack(images), wanted=("force_n",), progress=progress).force_n
    fine_s = np.arange(0, count / CAMERA_HZ, 1 / (40 * frequency_hz))
    found_n = found[:, scene.force_axes.index(2)]
    return Recording(frequency_hz, camera_s, np.array(true_n), found_n, fine_s, load_n(fine_s))


def outputs(recording: Recording, service: Fraction) -> Seen:
    """What a pipeline busy with each frame for `service` seconds makes of a recording."""
    index, starts = taken(Fraction(CAMERA_HZ), service, len(recording.found_n))
    output_s = np.array([float(start + service) for start in starts])
    rate_hz = (len(starts) - 1) / float(starts[-1] - starts[0])
    force_n = recording.found_n[index]
    sine = np.sin(2 * np.pi * recording.frequency_hz * recording.camera_s[index])
    expected_hz = spectrum(sine, rate_hz).peak_hz
    return Seen(output_s, force_n, rate_hz, spectrum(force_n, rate_hz), expected_hz)


def judge(recording: Recording, seen: Seen) -> dict:
    """Frequencies, expected and found, and whether the vibration was recovered, to within a bin.

    `alias_hz` is that of even sampling. Frames that are dropped make it uneven, which adds images about the
    camera's rate: at 104 outputs a second 100 Hz shows at 4 Hz and, from 240 − 100 Hz, at 36 Hz. Which one is
    larger depends on the phase; `expected_hz` is it.
    """
    frequency, found = seen.spectrum, seen.spectrum.peak_hz
    bin_hz = frequency.resolution_hz * (1 + 1e-9)
    return {
        "outputs": len(seen.force_n),
        "dropped_frames": len(recording.found_n) - len(seen.force_n),
        "mean_output_hz": seen.rate_hz,
        "resolution_hz": frequency.resolution_hz,
        "alias_hz": alias_hz(alias_hz(recording.frequency_hz, CAMERA_HZ), seen.rate_hz),
        "expected_hz": seen.expected_hz,
        "found_hz": found,
        "amplitude_n": float(frequency.amplitude[1:].max()),
        "as_expected": abs(found - seen.expected_hz) <= bin_hz,
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
    """The whole experiment: vibration.json and vibration.png in `folder`; returns what the JSON holds.

    Raises FingertipError for a scene that is recorded or has no F_z, ContactError for too much load.
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
        seen = {name: outputs(recording, service) for name, service in services.items()}
        shown.append((recording, seen))
        error = recording.found_n - recording.true_n
        found[str(frequency_hz)] = {
            "force_error_n": {"mean": float(error.mean()), "mean_absolute": float(np.abs(error).mean())},
            "pipelines": {name: judge(recording, one) for name, one in seen.items()},
            "true_force_z_n": recording.true_n.tolist(),
            "found_force_z_n": recording.found_n.tolist(),
        }
    fastest_hz = float(1 / services[OURS])
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


def section(folder: Path, bundle: Path, *, store: Path, progress: bool) -> None:
    """A step: the experiment as a section of the reproduction."""
    run(bundles.load(bundle), folder, store=store, progress=progress)


def lacks(scene: Scene) -> str | None:
    """Why a scene cannot show it, in one line; None if it can."""
    try:
        require_simulated(scene, "vibration", (2,))
    except FingertipError as error:
        return str(error)
    return None


def tables(content: dict) -> list[Table]:
    """The frequencies found, beside those that the paper recovers."""
    rows, keys = [], ("mean_output_hz", "alias_hz", "expected_hz", "found_hz")
    for frequency, found in content["frequencies"].items():
        for name, seen in found["pipelines"].items():
            verdict = "recovered" if seen["recovered"] else "aliased" if seen["as_expected"] else "wrong"
            paper = PAPER_RECOVERS.get(name)
            rows.append(
                [
                    f"{frequency} Hz",
                    name,
                    *(f"{seen[key]:.1f}" for key in keys),
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
            f"F_z of the integers: mean absolute error {1000 * np.mean(errors):.1f} mN, simulated."
            f" With as fast a camera, this design gives {projected:,.0f} forces a second (estimated: clock"
            " / interval).",
        )
    ]
