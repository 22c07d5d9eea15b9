"""A bottle held by two virtual fingertips and pushed down, with feedback of friction or slip and without it.

The fingers, the bottle and the hand are those of fastac/studies/demos/bottle.py; whether the bottle slips
follows from the contact mechanics. The controller sees only what the bundle's integer model finds in the
frames. Friction feedback is the paper's: μ_s follows from a slip test, a slow push without feedback until the
bottle slips. Slip feedback, where the scene has the output slip, knows neither μ nor the force: it closes the
fingers while the spread of the dots in contact is beyond `slip.limit_px` and rises. Everything is simulated.
"""

from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

import numpy as np

from fastac.flow import frames
from fastac.gateware.cycle_model import cycles
from fastac.models.emulator.pipeline import Emulator
from fastac.models.integer import bundle as bundles
from fastac.models.integer.bundle import Bundle
from fastac.report.tables import Table
from fastac.scenes.schema import Scene
from fastac.sensor.fingertip import require_friction
from fastac.sensor.mechanics.press import Rig
from fastac.sensor.mechanics.rig import rig_of
from fastac.sensor.protocol import FingertipError
from fastac.store.files import write_json
from fastac.store.progress import progress_bar
from fastac.studies.demos.bottle import Grasp, HeldBottle
from fastac.studies.demos.grip_control import (
    FrictionFeedback,
    GripControl,
    SlipFeedback,
    friction_ratio,
    without_feedback,
)
from fastac.studies.demos.records import SLIP_THRESHOLD_MM, GraspTrace, SlipTrace
from fastac.studies.demos.sampling import CAMERA_HZ

SLIP_TEST_PUSH, SLIP_TEST_FRAMES, SLIP_FRAMES = 4.0, 200, 5
"""Of the slip test: the largest push in multiples of the load that friction carries at the initial grip, the
frames in which it is reached, and the frames after the first slip whose median is taken."""
SLIP_OUTPUTS = ("slip_px", "slip_dots", "slipping")
"""What tells of slip, in the order of `SlipTrace`."""
RUNS = ("without_feedback", "with_feedback", "with_slip_feedback")
"""The grasps, in the order of tables and figures; the last one where the scene has the output slip."""


def run_control_loop(
    bundle: Bundle,
    hold: HeldBottle,
    pushes_n: Iterable[float],
    control: GripControl,
    label: str,
    *,
    progress: bool,
) -> GraspTrace:
    """Simulate the closed loop frame by frame: contact, camera, integer model, grip control.

    pushes_n : the hand's force for each frame, see `HeldBottle.step`; a generator may stop early
    """
    scene, emulator = bundle.scene, Emulator(bundle.pipeline)
    wanted = ("force_n", "validity", *(SLIP_OUTPUTS if scene.wants_slip else ()))
    rng, angle_deg, rows, slip_rows = np.random.default_rng(scene.protocol.seed), 0.0, [], []
    bar = progress_bar(pushes_n, desc=label, unit="frame", enabled=progress)
    for frame, push_n in enumerate(bar):
        pressed = hold.step(push_n, angle_deg)
        image = frames.of_press(pressed, scene.sensor, rng)
        found = emulator.run(image[None], wanted=wanted)
        force_n = found.force_n[0].astype(np.float64)
        state = (angle_deg, hold.hand_n, hold.lowered_mm, hold.slipped_mm, found.validity[0] != 0)
        rows.append((frame / CAMERA_HZ, pressed.force_n, force_n, *state))
        if scene.wants_slip:
            seen = (getattr(found, name)[0] for name in SLIP_OUTPUTS)
            slip_rows.append((*seen, hold.probe.state.sticking_share))
        flagged = scene.wants_slip and bool(found.slipping[0])
        angle_deg = control(force_n, float(found.slip_px[0]) if flagged else None)
    slip = SlipTrace(*_columns(slip_rows)) if scene.wants_slip else None
    return GraspTrace(*_columns(rows), slip)


def _columns(rows: list[tuple]) -> list[np.ndarray]:
    return [np.array(column) for column in zip(*rows, strict=True)]


def slip_test(bundle: Bundle, rig: Rig, grasp: Grasp, *, progress: bool) -> dict[str, float]:
    """μ at which the bottle slips under a slow push, from the integer model's forces and from the true ones.

    Each is the median over SLIP_FRAMES frames from the first slip on. Raises FingertipError without a slip.
    """
    hold = HeldBottle(rig, grasp)
    carried_n = 2 * rig.sensor.elastomer.friction * grasp.grip_n

    def pushes():
        for push_n in np.linspace(0, SLIP_TEST_PUSH * carried_n, SLIP_TEST_FRAMES)[1:]:
            yield push_n
            if hold.slipped_mm > SLIP_THRESHOLD_MM:
                for _ in range(SLIP_FRAMES - 1):
                    yield push_n
                return

    control = GripControl(without_feedback, 0.0, 0.0)
    trace = run_control_loop(bundle, hold, pushes(), control, "slip test", progress=progress)
    if hold.slipped_mm <= SLIP_THRESHOLD_MM:
        raise FingertipError(f"grasp: hand_n_per_mm = {grasp.hand_n_per_mm:g}: no push makes the bottle slip")
    found, true = (
        np.median(friction_ratio(force_n)[-SLIP_FRAMES:])
        for force_n in (trace.found_force_n, trace.true_force_n)
    )
    return {"found_ratio": float(found), "true_ratio": float(true)}


def run(
    bundle: Bundle,
    folder: Path,
    *,
    grasp: Grasp | None = None,
    store: Path = frames.STORE,
    progress: bool = True,
) -> dict:
    """Run slip test and all grasps; write grasp.json and grasp.png into `folder`; return the JSON's content.

    Raises FingertipError for a scene without friction or three axes of force, and for impossible parameters;
    ContactError where the bottle falls or the indentation exceeds the gel.
    """
    from fastac.studies.demos import time_figures

    scene = bundle.scene
    require_friction(scene, "grasp")
    grasp = (grasp or Grasp()).of_scene(scene)
    rig = rig_of(scene.sensor, store, progress=progress)
    test = slip_test(bundle, rig, grasp, progress=progress)
    stable, margin = grasp.stable_share * test["found_ratio"], grasp.margin_share * test["found_ratio"]
    pipeline = bundle.pipeline
    found = cycles(scene, hidden=pipeline.hidden, follower=pipeline.follower)
    latency_s = found["first_pixel_to_force"] / (scene.hardware.clock_mhz * 1e6)
    delay_frames = 1 + int(latency_s * CAMERA_HZ)
    rules, traces = dict(zip(RUNS, (without_feedback, FrictionFeedback(stable, margin)), strict=False)), {}
    if scene.wants_slip:
        rules["with_slip_feedback"] = SlipFeedback()
    for name, rule in rules.items():
        control = GripControl(rule, grasp.step_deg, grasp.most_deg, delay_frames)
        pushes_n = [grasp.push_n(k / CAMERA_HZ) for k in range(round(grasp.seconds * CAMERA_HZ))]
        label = name.replace("_", " ")
        traces[name] = run_control_loop(
            bundle, HeldBottle(rig, grasp), pushes_n, control, label, progress=progress
        )
    content = {
        "source": "simulated",
        "scene": scene.name,
        "bundle": bundle.digest,
        "grasp": {**asdict(grasp), "pushes_n": list(grasp.pushes_n)},
        "camera_hz": CAMERA_HZ,
        "friction": scene.sensor.elastomer.friction,
        "slip_test": test,
        "stable_ratio": stable,
        "margin": margin,
        **({"limit_px": scene.slip.limit_px} if scene.wants_slip else {}),
        "latency_ms": {"value": 1000 * latency_s, "origin": "estimated: cycles / hardware.clock_mhz"},
        "delay_frames": delay_frames,
        **{name: trace.summary() for name, trace in traces.items()},
    }
    folder.mkdir(parents=True, exist_ok=True)
    time_figures.grasp(traces, content, folder / "grasp.png")
    write_json(folder / "grasp.json", content)
    return content


def section(folder: Path, scene: Scene, bundle: Path, *, store: Path, progress: bool) -> None:
    """A step: the experiment as a section of the reproduction."""
    run(bundles.load_for(bundle, scene), folder, store=store, progress=progress)


def lacks(scene: Scene) -> str | None:
    """One line that says why the scene does not allow this experiment; None if it does."""
    try:
        require_friction(scene, "grasp")
    except FingertipError as error:
        return str(error)
    return None


def tables(content: dict) -> list[Table]:
    """Slip, tightening and force errors of all grasps, from the content of grasp.json.

    Where the scene has the output slip, also when it was first flagged, and how many nodes stuck then.
    """
    rows, slip = [], "limit_px" in content
    for name in RUNS:
        if name not in content:
            continue
        one = content[name]
        row = [
            name.replace("_", " "),
            "slips" if one["slipped"] else "holds",
            f"{one['slipped_mm']:.3f}",
            f"{one['tightened_deg']:.2f}",
            f"{one['largest_ratio']['true']:.3f}",
            *(f"{1000 * error:.0f}" for error in one["force_error_n"].values()),
        ]
        if slip:
            first = one["first_slipping"]
            row += ["", ""] if first is None else [f"{first['time_s']:.2f}", f"{100 * first['sticking']:.0f}"]
        rows.append(row)
    head = ["fingers", "bottle", "slip, mm", "tightened, °", "largest true μ"]
    head += [f"error F_{axis}, mN" for axis in "xyz"]
    head += ["flagged from, s", "sticking then, %"] if slip else []
    test = content["slip_test"]
    note = (
        f"slip test: μ = {test['found_ratio']:.3f} found, {test['true_ratio']:.3f} true;"
        f" tightened above μ_s + d = {content['stable_ratio']:.3f} + {content['margin']:.3f}"
    )
    if slip:
        note += f", or where the spread of the dots in contact is more than {content['limit_px']:g} px"
    return [Table("A bottle, pushed down", head, rows, f"{note}; simulated")]
