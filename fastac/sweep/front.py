"""Questions to the results of sweeps: Pareto fronts, the price of speed, the best scene within limits."""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from operator import ge, gt, le, lt
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ValidationError

from fastac.scenes import schema as scenes
from fastac.scenes.schema import Scene
from fastac.sweep import scene_file
from fastac.sweep.results import Results, ResultsError, Row

ERRORS = {
    "normal_mae_deg": "normal error, °",
    "depth_mae_mm": "depth error, mm",
    "force_z_mae_n": "force error, F_z, N",
}
COSTS = {
    "latency_cycles": "cycles from first pixel to result",
    "dsp": "DSP slices",
    "energy_uj": "energy of a frame, estimate, µJ",
}
"""Metrics that the fronts weigh against the errors, with their labels."""
COMPARE = {"<": lt, "<=": le, ">": gt, ">=": ge}
LIMIT = re.compile(r"\s*([A-Za-z_][A-Za-z0-9_]*)\s*(<=|>=|<|>)\s*(\S+)\s*")
BITS = ("numbers.weight_bits", "numbers.activation_bits", "numbers.last_weight_bits")
TUNING = ("training.finetune_epochs", "training.finetune_weights", "training.finetune_learning_rate")


class TradeError(ValueError):
    """A question that the results cannot answer; the message is one line."""


class _Facts(BaseModel):
    """What the page needs of a file's facts."""

    scene: Scene
    origins: dict[str, str] = {}


class _Confirmation(BaseModel):
    """What the page needs of a simulation's findings."""

    is_exact: bool
    mismatches: int
    values_compared: int
    cycles_counted: dict[str, int]


@dataclass(frozen=True)
class Source:
    """A results file, the facts that its points have in common, and the points."""

    results: Results
    facts: dict
    rows: list[Row]

    @property
    def done(self) -> list[Row]:
        return [row for row in self.rows if row.status == "done"]


def read(path: Path) -> Source:
    """The points of the newest generation in a results file.

    Raises ResultsError for a file that cannot be read, TradeError where no point is done.
    """
    results = Results(path, create=False)
    facts = results.facts()
    found = Source(results, facts, results.rows(facts.get("generation")))
    if not found.done:
        raise TradeError(f"{path}: no point is done")
    _check(found, path)
    return found


def _check(source: Source, path: Path) -> None:
    """Raise ResultsError unless facts, scenes and confirmations have what `fastac sweep` writes of them."""
    try:
        _Facts.model_validate(source.facts)
    except ValidationError as error:
        raise ResultsError(f"{path}: facts: {scenes.describe(error)}") from None
    for row in source.done:
        try:
            Scene.model_validate(row.scene)
        except ValidationError as error:
            raise ResultsError(f"{path}: point {row.key}: scene: {scenes.describe(error)}") from None
    for key, content in source.results.confirmations().items():
        try:
            _Confirmation.model_validate(content)
        except ValidationError as error:
            raise ResultsError(f"{path}: confirmation {key}: {scenes.describe(error)}") from None


def distinct(sources: Iterable[Source]) -> list[tuple[Source, Row]]:
    """All points that are done, each once, with the file that it comes from."""
    found = {}
    for source in sources:
        for row in source.done:
            found.setdefault(row.key, (source, row))
    return list(found.values())


def is_on_front(values: np.ndarray) -> np.ndarray:
    """Which points are Pareto-optimal, bool (points,), of `values` (points, metrics), all to be small.

    A point is on the front if no other one is at most as large in every metric; of equal points the first is.
    """
    kept = np.ones(len(values), bool)
    for k, value in enumerate(values):
        no_worse = (values <= value).all(axis=1)
        better = (values < value).any(axis=1)
        earlier = np.arange(len(values)) < k
        kept[k] = not (no_worse & (better | earlier)).any()
    return kept


def with_metrics(rows: Iterable[Row], names: Sequence[str]) -> list[Row]:
    """The rows that have all these metrics."""
    return [row for row in rows if all(name in row.metrics for name in names)]


def front(rows: Iterable[Row], names: Sequence[str]) -> list[Row]:
    """The Pareto front of the rows over the metrics `names`, sorted by the last of them."""
    rows = with_metrics(rows, names)
    if not rows:
        return []
    values = np.array([[row.metrics[name] for name in names] for row in rows])
    kept = [row for row, best in zip(rows, is_on_front(values), strict=True) if best]
    return sorted(kept, key=lambda row: row.metrics[names[-1]])


def best_designs(rows: Iterable[Row]) -> list[Row]:
    """The designs on the front over one of the errors and all costs, for each error that is known.

    Raises TradeError where no design has an error.
    """
    rows = list(rows)
    found = {row.key: row for error in ERRORS for row in front(rows, (error, *COSTS))}
    if not found:
        raise TradeError(f"no point has an error of {', '.join(ERRORS)}")
    return list(found.values())


def faster(rows: Iterable[Row], error: str) -> list[tuple[float, Row]]:
    """The price of speed: pairs of a speed-up and the row with the least error at that speed.

    The first row is the most accurate of all; the next ones take at most 1/2, 1/4, … of its cycles.
    """
    rows = with_metrics(rows, (error, "latency_cycles"))
    found: list[tuple[float, Row]] = []
    factor = 1
    while rows:
        best = min(rows, key=lambda row: (row.metrics[error], row.metrics["latency_cycles"]))
        start = found[0][1] if found else best
        ratio = start.metrics["latency_cycles"] / best.metrics["latency_cycles"]
        if not found or best is not found[-1][1]:
            found.append((ratio, best))
        factor *= 2
        limit = start.metrics["latency_cycles"] / factor
        rows = [row for row in rows if row.metrics["latency_cycles"] <= limit]
    return found


def flat(content: dict, prefix: str = "") -> dict:
    """A scene's nested JSON as one dictionary with dotted keys, such as "sensor.width_px"."""
    found = {}
    for key, value in content.items():
        found |= flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return found


def differences(row: Row, base: dict) -> dict:
    """The keys in which a row's scene differs from a base scene, with the row's values."""
    mine, its = flat(row.scene), flat(base)
    return {
        k: v for k, v in mine.items() if its.get(k) != v and k != "name" and not k.startswith("simulation.")
    }


def one_at_a_time(source: Source) -> dict[str, list[tuple[object, Row]]]:
    """By key, the rows that differ from the base scene in that key alone, and the base, by value."""
    base = source.facts["scene"]
    found: dict[str, list[tuple[object, Row]]] = {}
    same = [row for row in source.done if not differences(row, base)]
    for row in source.done:
        changed = differences(row, base)
        if len(changed) == 1:
            [(key, value)] = changed.items()
            found.setdefault(key, []).append((value, row))
    for key, rows in found.items():
        rows += [(flat(base)[key], row) for row in same]
        rows.sort(key=lambda pair: (str(type(pair[0])), pair[0]))
    return found


def tuned(source: Source) -> list[tuple[dict, Row]]:
    """Rows that compare bit-true fine-tuning with post-training quantisation (0 epochs), with their values.

    They differ from the base scene in `BITS` and `TUNING` only and have as many bits for weights as for
    activations; empty unless there are rows of both kinds.
    """
    found = []
    for row in source.done:
        values = flat(row.scene)
        if (
            set(differences(row, source.facts["scene"])) <= {*BITS, *TUNING}
            and values[BITS[0]] == values[BITS[1]]
        ):
            found.append(({key: values[key] for key in (*BITS, *TUNING)}, row))
    if len({bool(values[TUNING[0]]) for values, _ in found}) < 2:
        return []
    return sorted(
        found, key=lambda pair: (-pair[0][BITS[0]], *(float(pair[0][k]) for k in (BITS[2], *TUNING)))
    )


def is_scene(row: Row, scene: Scene) -> bool:
    """Whether the row's scene equals this one, names aside."""
    return not differences(row, scene.model_dump(mode="json"))


def limits(text: str, names: Iterable[str]) -> list[tuple[str, Callable[[float, float], bool], float]]:
    """What `--pick` asks for: "depth_mae_mm<0.03, dsp<220" as (name, comparison, number).

    Raises TradeError for anything else, and for a name that is not among the metrics.
    """
    found, known = [], sorted(names)
    for part in text.split(","):
        matched = LIMIT.fullmatch(part)
        if matched is None:
            raise TradeError(f"--pick {part.strip()!r}: expected a metric, one of < <= > >=, and a number")
        name, sign, number = matched.groups()
        if name not in known:
            raise TradeError(f"--pick {name!r}: no such metric; there are {', '.join(known)}")
        try:
            value = float(number)
        except ValueError:
            raise TradeError(f"--pick {part.strip()!r}: {number!r} is no number") from None
        if not np.isfinite(value):
            raise TradeError(f"--pick {part.strip()!r}: expected a finite number")
        found.append((name, COMPARE[sign], value))
    return found


def asked(text: str) -> list[str]:
    """The names of the metrics in limits such as "dsp<220, lut<9000"."""
    return [LIMIT.fullmatch(part)[1] for part in text.split(",")]


def metric_names(rows: Iterable[Row]) -> set[str]:
    """The metrics that any row has."""
    return {name for row in rows for name in row.metrics}


def pick(rows: Iterable[Row], text: str, by: Sequence[str]) -> Row:
    """The row within the limits `text` that is smallest in the first metric of `by`, then in the next.

    Raises TradeError where no row is within the limits.
    """
    rows = list(rows)
    names = metric_names(rows)
    wanted = limits(text, names)
    for name in by:
        if name not in names:
            raise TradeError(f"--by {name!r}: no such metric; there are {', '.join(sorted(names))}")
    rows = with_metrics(rows, by)
    for name, compare, value in wanted:
        rows = [row for row in rows if name in row.metrics and compare(row.metrics[name], value)]
        if not rows:
            raise TradeError(f"--pick {text!r}: no design meets all limits; that on {name} leaves none")
    return min(rows, key=lambda row: [row.metrics[name] for name in by])


def write_scene(row: Row, path: Path, origin: str) -> Scene:
    """Write the row's scene as TOML for `fastac build`, named after the file, with `origin` as a comment."""
    figures = [f"{name} = {value:.6g}" for name, value in sorted(row.metrics.items())]
    return scene_file.write(row.scene, path, [origin, *figures])
