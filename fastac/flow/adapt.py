"""Another unit of a sensor: a few presses of it make a calibration for hardware built from the first one.

Steps, kept in the store: what is tuned (`choice`), the float network (`tuned`), the integers
(`requantised`), and the bundle with the words that the hardware takes (`adapted`). Word lengths, tables that
are no part of a calibration, the skin at rest and the force's weights are those of the bundle that was given;
the background is the new unit's.
"""

import copy
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from fastac.export.card import ADAPTED_FROM
from fastac.flow import training
from fastac.flow.few_presses import known_presses, pixels_of, pressed_skins, presses, read
from fastac.flow.force_scale import with_force_scale
from fastac.flow.intervals import widened
from fastac.flow.pipelines import dots_at_rest, layers_pipeline
from fastac.gateware import calibration
from fastac.models.emulator.pipeline import with_limits
from fastac.models.floating.network import PixelNetwork
from fastac.models.integer import bundle as bundles
from fastac.models.integer import quantise
from fastac.models.integer.bundle import Bundle
from fastac.models.integer.frame_validity import FrameValidity
from fastac.models.integer.network import Layer
from fastac.models.integer.pipeline import IntegerPipeline
from fastac.models.training import bit_true, transfer
from fastac.models.training.pruning.prune import gradient_error
from fastac.report.tables import text_table
from fastac.scenes.schema import Scene
from fastac.sensor.dataset import Dataset
from fastac.store.files import load_arrays, read_json, save_arrays, write_json
from fastac.store.progress import progress_bar
from fastac.store.steps import Step
from fastac.store.store import open_store

WEIGHTS, INTEGERS = "normals.npz", "integers.npz"
BUNDLE, WORDS, SUMMARY = "bundle", "calibration.bin", "adapt.json"
FEWEST_TO_CHOOSE = 3
"""Presses from which on what is tuned is chosen by cross-validation; with fewer nothing is."""
FOLDS = 3
FINETUNE_STEPS = 400
"""Steps of the bit-true fine-tuning, at least, whatever number of presses there is."""
NOTHING = "none"
"""What is tuned where the network stays as it was, with the new unit's background."""
CHOICES = (NOTHING, *transfer.TUNES)
"""What can be tuned, the fewest numbers first."""


def start(known: Bundle, x: np.ndarray, y: np.ndarray) -> PixelNetwork:
    """The bundle's float network, no wider than its hardware."""
    hidden, limit = known.pipeline.hidden, known.scene.numbers.slope_limit
    return transfer.narrowed(PixelNetwork.from_arrays(known.floats), x, y, hidden, limit)


def choice(folder: Path, scene: Scene, bundle: Path, data: Path, *, store: Path, progress: bool) -> dict:
    """A step: what to tune, and the slope errors of held-out presses that say so, as
    {"presses": n, "tune": …, "errors": {what: {press: error}} or None}.

    Presses are held out whole, in FOLDS parts; the errors are mean absolute errors of both slopes together.
    What tunes the fewest numbers is chosen of all that are no worse than the best by more than one standard
    error of the difference between presses. Too few presses are not held out at all, and tune nothing: with
    a single one normals became worse than with the new background alone, on simulated and on real units.
    """
    known, shown = bundles.load_for(bundle, scene), read(data, scene, store=store, progress=progress)
    few = training.skin_alone(shown, scene)
    press, names = presses(few), known_presses(few)
    if len(names) < FEWEST_TO_CHOOSE:
        return {"presses": len(names), "tune": NOTHING, "errors": None}
    order = np.random.default_rng(scene.training.seed).permutation(len(names))
    errors = {what: {} for what in CHOICES}
    bar = progress_bar(total=FOLDS * len(transfer.TUNES), desc="choice", unit="tuning", enabled=progress)
    for fold in range(FOLDS):
        held = [names[k] for k in order[fold::FOLDS]]
        seen = (few.split != "test") & ~np.isin(press, held)
        x, y = pixels_of(few, scene, seen)
        keys = {
            "pressed": pressed_skins(known, shown, few, seen),
            "rounding_bits": scene.felt_rounding_bits,
        }
        begun = start(known, x, y)
        networks = {NOTHING: begun}
        for what in transfer.TUNES:
            networks[what], _ = transfer.tune(copy.deepcopy(begun), x, y, scene.training, what, **keys)
            bar.update()
        for name in held:
            truth = pixels_of(few, scene, (few.split != "test") & (press == name))
            for what, network in networks.items():
                errors[what][name] = gradient_error(network, *truth, scene.numbers.slope_limit)
    bar.close()
    return {"presses": len(names), "tune": simplest(errors), "errors": errors}


def simplest(errors: dict[str, dict[str, float]]) -> str:
    """Of CHOICES, what tunes the fewest numbers and is no worse than the best by more than one standard error
    of the difference."""
    table = {what: np.array(list(errors[what].values())) for what in CHOICES}
    best = min(table.values(), key=np.mean)
    for what, values in table.items():
        excess = values - best
        if excess.mean() <= excess.std(ddof=1) / np.sqrt(len(excess)):
            return what
    raise AssertionError("the best is no worse than itself")


def tuned(
    folder: Path, scene: Scene, bundle: Path, data: Path, tune: str, *, store: Path, progress: bool
) -> None:
    """A step: the float network, tuned on all presses, and its learning curve."""
    known, shown = bundles.load_for(bundle, scene), read(data, scene, store=store, progress=progress)
    few = training.skin_alone(shown, scene)
    seen = few.split != "test"
    x, y = pixels_of(few, scene, seen)
    network, history = transfer.tune(
        start(known, x, y),
        x,
        y,
        scene.training,
        tune,
        pressed=pressed_skins(known, shown, few, seen),
        rounding_bits=scene.felt_rounding_bits,
        progress=progress,
    )
    arrays = network.arrays | training.curve(history, "normals")
    save_arrays(folder / WEIGHTS, arrays)


def requantised(
    folder: Path, scene: Scene, data: Path, weights: Path, *, store: Path, progress: bool
) -> None:
    """A step: the integers of the tuned network, fine-tuned bit-true."""
    few = training.skin_alone(read(data, scene, store=store, progress=progress), scene)
    seen, _ = pixels_of(few, scene, few.split != "test")
    settings, network = scene.training, PixelNetwork.from_arrays(load_arrays(weights))
    x = transfer.at_other_places(seen, settings.seed)
    layers = training.quantised(network, x, scene)
    epochs = settings.finetune_epochs
    if epochs:
        epochs = max(epochs, -(-FINETUNE_STEPS // -(-len(x) // settings.normals_batch_px)))
    of_network = np.zeros((len(x), 3), np.float32)  # the teacher's outputs replace them
    layers, history = bit_true.finetune(
        {"train": (x, of_network)}, layers, network, settings, epochs=epochs, progress=progress
    )
    save_arrays(folder / INTEGERS, quantise.layers_to_arrays(layers) | training.curve(history, "finetune"))


def pipeline_of(layers: tuple[Layer, ...], data: Dataset, known: Bundle) -> IntegerPipeline:
    """The integers up to the force: new layers and background, the skin at rest of the known bundle."""
    return layers_pipeline(layers, data, known.scene, known.pipeline.rest_depth_mm)


def loadable(made: Bundle, known: Bundle, folder: Path) -> Bundle:
    """The bundle with the force and as many neurons as the hardware of `known`, saved to `folder`.

    Raises CalibrationError, one line that says what differs, where it cannot be loaded there.
    """
    if known.pipeline.force is not None:
        made = calibration.with_hardware_force(made, known, folder)
    else:
        made = bundles.save(folder, calibration.as_wide_as(made.pipeline, known.pipeline), made.floats)
    calibration.calibration_words(made, known)
    return made


def adapted(
    folder: Path,
    scene: Scene,
    bundle: Path,
    data: Path,
    chosen: dict,
    weights: Path | None,
    integers: Path | None,
    *,
    store: Path,
    progress: bool,
) -> None:
    """A step: the new bundle, the words that the old one's hardware takes, and what was done.

    weights, integers : of the tuned network; None: the network stays as it is
    """
    known, few = bundles.load_for(bundle, scene), read(data, scene, store=store, progress=progress)
    if weights is None:
        floats, layers = dict(known.floats), known.pipeline.layers
    else:
        floats, integer = load_arrays(weights), load_arrays(integers)
        floats |= {name: values for name, values in integer.items() if name.startswith("history.")}
        layers = quantise.layers_from_arrays(integer)
    if scene.wants_dots:
        floats |= dots_at_rest(few, scene)
    pipeline = pipeline_of(layers, few, known)
    made = loadable(Bundle(pipeline, floats, ""), known, folder / "loadable")
    seen = np.flatnonzero(few.split != "test")
    made, force = with_force_scale(made, few, seen)
    wider, of_intervals, intervals = widened(known, made.pipeline, few)
    limited = with_limits(wider, few.frames[seen])
    validity = as_wide_limits(limited.validity, known.pipeline.validity)
    about = {
        **training.provenance(few),
        **of_intervals,
        ADAPTED_FROM: known.digest,
        "presses": chosen["presses"],
        "tuned": chosen["tune"],
        "force": force,
        "intervals": intervals,
    }
    pipeline = limited.replace(validity=validity, provenance=about)
    made = bundles.save(folder / BUNDLE, pipeline, made.floats)
    words = calibration.calibration_words(made, known)
    (folder / WORDS).write_bytes(words.astype("<u4").tobytes())
    about |= {"bundle_sha256": made.digest, "words": len(words), "layout": int(words[0])}
    write_json(folder / SUMMARY, about | {"slope_errors": chosen["errors"]})


def as_wide_limits(few: FrameValidity, known: FrameValidity) -> FrameValidity:
    """The limits of few presses, as wide at least as those of the first unit: few show few good frames."""
    return replace(few, low=np.minimum(few.low, known.low), high=np.maximum(few.high, known.high))


def adapt(
    source: Path,
    data: Path,
    output: Path,
    tune: str | None = None,
    *,
    announce: Callable[[str, str], None] | None = None,
    progress: bool = True,
) -> dict:
    """Adapt the bundle `source` to the presses in `data`; writes the folder `output`, whole, and returns what
    its file SUMMARY says.

    tune : one of CHOICES; None: chosen, see `choice`
    Raises AdaptError, DatasetError or CalibrationError, before anything is trained as far as it can be known.
    """
    source = bundles.bundle_folder(source)
    known, store = bundles.load(source), output.absolute().parent / "store"
    few = read(data, known.scene, store=store, progress=progress)
    with tempfile.TemporaryDirectory() as place:
        pipeline = pipeline_of(known.pipeline.layers, few, known)
        loadable(Bundle(pipeline, known.floats, ""), known, Path(place) / "loadable")
    given = {"scene": known.scene, "bundle": source, "data": data}
    quiet = {"store": store, "progress": progress}
    kept = open_store(store)
    if tune is None:
        chosen = kept.value(Step("choice", choice, given, (), quiet), announce)
    else:
        chosen = {"presses": len(known_presses(few)), "tune": tune, "errors": None}
    weights = integers = None
    if chosen["tune"] != NOTHING:
        weights = Step("tuned", tuned, given | {"tune": chosen["tune"]}, (WEIGHTS,), quiet).output(WEIGHTS)
        of_data = {"scene": known.scene, "data": data, "weights": weights}
        integers = Step("requantised", requantised, of_data, (INTEGERS,), quiet).output(INTEGERS)
    made = given | {"chosen": chosen, "weights": weights, "integers": integers}
    entry = kept.perform(Step("adapted", adapted, made, (BUNDLE, WORDS, SUMMARY), quiet), announce)
    entry.place(output)
    return read_json(output / SUMMARY)


def table(errors: dict[str, dict[str, float]]) -> str:
    """The slope errors of held-out presses, by what was tuned."""
    rows = []
    for what, of_presses in errors.items():
        values = np.array(list(of_presses.values()))
        spread = values.std(ddof=1) / np.sqrt(len(values))
        rows.append([what, f"{values.mean():.4f}", f"{spread:.4f}"])
    return text_table(["tuned", "slope error", "standard error"], rows)
