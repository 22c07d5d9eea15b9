"""Trains candidates on parts of the data, chooses one, and finds what the choice is worth."""

from collections.abc import Iterable, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass, field

import numpy as np

from fastac.scenes.schema import Scene, with_seed
from fastac.store.progress import progress_bar
from fastac.store.store import open_store
from fastac.sweep.spec import Point
from fastac.tune import choice
from fastac.tune.choice import Pair
from fastac.tune.groups import TuneError
from fastac.tune.trial import Source, perform, step_of

OWN = 0
"""The candidate that is the scene itself."""
FEW_UNITS = 10
"""Below this the nested error itself is uncertain by a third or more."""


@dataclass
class Tuning:
    """What is compared, and what was found so far.

    folds : names of the units in each; seeds : trainings of what is judged at the end
    errors : as in `choice.Errors`; outer : by candidate, seed and outer fold, errors by unit and metric
    """

    candidates: list[Point]
    folds: list[list[str]]
    source: Source
    seeds: int
    executor: Executor
    progress: bool
    metrics: tuple[str, ...] = ()
    errors: dict[tuple[int, Pair], dict[int, float]] = field(default_factory=dict)
    refused: dict[int, str] = field(default_factory=dict)
    rungs: list[dict[int, float]] = field(default_factory=list)
    outer: dict[tuple[int, int, int], dict[str, dict[str, float]]] = field(default_factory=dict)
    tests: dict[tuple[int, int], dict] = field(default_factory=dict)

    def scene(self, candidate: int, seed: int = 0) -> Scene:
        """A candidate's scene with its `seed`-th seed."""
        found = self.candidates[candidate].scene
        return with_seed(found, found.training.seed + seed)

    def units(self, folds: Sequence[int]) -> list[str]:
        return [name for fold in folds for name in self.folds[fold]]

    def perform(self, tasks: Sequence[tuple[int, int, tuple[int, ...] | None]], label: str) -> list[object]:
        """What trials found, (candidate, seed, folds left out or None), side by side; None where one was
        refused.

        Raises TuneError where the scene itself cannot be trained.
        """
        given = [
            (self.scene(candidate, seed), None if out is None else self.units(out))
            for candidate, seed, out in tasks
        ]
        found: list[object] = [None] * len(tasks)
        kept = open_store(self.source.store)
        missing = []
        for k, (scene, held_out) in enumerate(given):
            step = step_of(scene, self.source, held_out)
            if kept.is_current(step):
                found[k] = kept.value(step)
            else:
                missing.append(k)
        bar = progress_bar(total=len(tasks), desc=label, unit="training", enabled=self.progress, leave=True)
        bar.update(len(tasks) - len(missing))
        futures = {
            self.executor.submit(perform, given[k][0].model_dump(mode="json"), self.source, given[k][1]): k
            for k in missing
        }
        try:
            for future in as_completed(futures):
                k = futures[future]
                try:
                    found[k] = future.result()
                except ValueError as error:
                    self._refuse(tasks[k][0], " ".join(str(error).split()))
                bar.update()
        except BaseException:
            for future in futures:  # not every executor's `shutdown` cancels them
                future.cancel()
            raise
        finally:
            bar.close()
        return found

    def perform_all(
        self, tasks: Sequence[tuple[int, int, tuple[int, ...] | None]], label: str
    ) -> list[object]:
        """As `perform`; raises TuneError where any trial was refused."""
        found = self.perform(tasks, label)
        for (candidate, *_), value in zip(tasks, found, strict=True):
            if value is None:
                raise TuneError(f"{self.candidates[candidate].axes}: {self.refused[candidate]}")
        return found

    def _refuse(self, candidate: int, reason: str) -> None:
        if candidate == OWN:
            raise TuneError(reason)
        self.refused[candidate] = reason

    def compare(self, those: Sequence[int], used: Sequence[Pair], label: str) -> None:
        """Train candidates without each pair of folds, and keep their errors on both."""
        tasks = [(candidate, 0, pair) for candidate in those for pair in used]
        for (candidate, _, pair), value in zip(tasks, self.perform(tasks, label), strict=True):
            if value is None:
                self.errors[candidate, pair] = dict.fromkeys(pair, np.inf)
                continue
            self.check_metrics(value, pair)
            self.errors[candidate, pair] = {
                fold: choice.score([value[name] for name in self.folds[fold]], self.metrics) for fold in pair
            }

    def check_metrics(self, value: dict[str, dict[str, float]], folds: Iterable[int]) -> None:
        """Settle on the metrics that units have, or raise TuneError for a fold in which one is missing."""
        if not self.metrics:
            self.metrics = tuple(dict.fromkeys(name for errors in value.values() for name in errors))
        for units in (self.folds[fold] for fold in folds):
            known = dict.fromkeys(name for unit in units for name in value[unit])
            for name in self.metrics or ("",):
                if name not in known:
                    raise TuneError(
                        f"{self.source.data}: {', '.join(units)}: no error {name!r} is known; there are"
                        f" {', '.join(known) or 'none'}"
                    )

    def run(self) -> dict:
        """Compare all candidates, judge the choice, look at the test split once; returns the content of
        tune.json."""
        chosen, best, alike = (
            self.choose() if len(self.candidates) > 1 else ([OWN] * len(self.folds), OWN, [OWN])
        )
        self.judge(chosen)
        gained = self.nested(chosen)["score"] < self.nested([OWN] * len(self.folds))["score"]
        winner = best if gained else OWN
        self.test(winner)
        return self.content(chosen, winner, best, alike)

    def choose(self) -> tuple[list[int], int, list[int]]:
        """Compare the candidates; returns the best for each outer fold, the best of all, and those that are
        as good as far as can be told."""
        those, used = list(range(len(self.candidates))), []
        for number, rung in enumerate(choice.pairs(len(self.folds)), 1):
            used += rung
            self.compare(those, rung, f"compare {len(those)} candidates, rung {number}")
            those = [candidate for candidate in those if candidate not in self.refused]
            self.rungs.append({c: float(choice.inner(self.errors, c, None, used).mean()) for c in those})
            finalists = those
            those = sorted(choice.survivors(self.errors, those, len(self.folds), used) | {OWN})
        chosen = [choice.ranked(self.errors, finalists, k, used)[0] for k in range(len(self.folds))]
        best = choice.ranked(self.errors, finalists, None, used)[0]
        return chosen, best, choice.indistinguishable(self.errors, finalists, used)

    def judge(self, chosen: Sequence[int]) -> None:
        """The nested errors: on each outer fold of the candidate chosen without it, and of the scene itself,
        each trained with every seed on everything else."""
        tasks = [
            (candidate, seed, (fold,))
            for fold, winner in enumerate(chosen)
            for candidate in sorted({winner, OWN})
            for seed in range(self.seeds)
        ]
        found = self.perform_all(tasks, "nested errors")
        for (candidate, seed, (fold,)), value in zip(tasks, found, strict=True):
            self.check_metrics(value, (fold,))
            self.outer[candidate, seed, fold] = value

    def nested(self, by_fold: Sequence[int]) -> dict:
        """The nested errors of one candidate a fold: {"score": …, metric: {"mean": …, "spread": …, "folds":
        [...]}}, means over units and seeds, the seeds' standard deviation as of a sample."""
        values = [
            [self.outer[candidate, seed, fold] for fold, candidate in enumerate(by_fold)]
            for seed in range(self.seeds)
        ]
        found: dict = {}
        for name in self.metrics:
            means = [choice.mean([e for fold in folds for e in fold.values()], name) for folds in values]
            of_folds = [
                choice.mean([e for folds in values for e in folds[k].values()], name)
                for k in range(len(by_fold))
            ]
            spread = float(np.std(means, ddof=1)) if self.seeds > 1 else 0.0
            found[name] = {"mean": float(np.mean(means)), "spread": spread, "folds": of_folds}
        every = [errors for folds in values for fold in folds for errors in fold.values()]
        return {"score": choice.score(every, self.metrics), **found}

    def test(self, winner: int) -> None:
        """The split test, once: the winner and the scene itself, with every seed."""
        data, _ = self.source.read(self.scene(OWN))
        if self.source.with_test or not len(data.indices("test")):
            return
        tasks = [(candidate, seed, None) for candidate in sorted({winner, OWN}) for seed in range(self.seeds)]
        found = self.perform_all(tasks, "test presses")
        for (candidate, seed, _), value in zip(tasks, found, strict=True):
            self.tests[candidate, seed] = value

    def content(self, chosen: Sequence[int], winner: int, best: int, alike: Sequence[int]) -> dict:
        """What tune.json holds."""
        own = [OWN] * len(self.folds)
        return {
            "scene": self.scene(OWN).model_dump(mode="json"),
            "data": str(self.source.data),
            "metrics": list(self.metrics),
            "folds": self.folds,
            "seeds": self.seeds,
            "candidates": [point.axes for point in self.candidates],
            "refused": {str(candidate): reason for candidate, reason in self.refused.items()},
            "rungs": [{str(c): value for c, value in rung.items()} for rung in self.rungs],
            "chosen_by_outer_fold": list(chosen),
            "indistinguishable": list(alike),
            "best": best,
            "winner": winner,
            "nested": {"scene": self.nested(own), "chosen": self.nested(chosen)},
            "test": {
                name: [self.tests[candidate, seed] for seed in range(self.seeds)]
                for name, candidate in (("scene", OWN), ("winner", winner))
                if self.tests
            },
            "warnings": self.warnings(winner, best, alike),
        }

    def warnings(self, winner: int, best: int, alike: Sequence[int]) -> list[str]:
        """Where the data cannot carry the choice."""
        found, units = [], sum(map(len, self.folds))
        if units < FEW_UNITS:
            found.append(
                f"{units} groups or presses are few: errors on other ones may differ much from these"
            )
        if len(alike) > 1:
            found.append(
                f"{len(alike)} of {len(self.rungs[-1])} finalists are within one standard error of the best:"
                " these data cannot tell them apart"
            )
        if winner != best:
            found.append(
                "what was chosen is no better on folds that had no say in it: the scene is kept as is"
            )
        return found
