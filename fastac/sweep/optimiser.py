"""The points of a sweep that Optuna chooses: several objectives at once, resumable."""

from pathlib import Path

import optuna

from fastac.scenes.schema import Scene
from fastac.sweep.results import Results, Row
from fastac.sweep.spec import Point, Spec, expand, point_of


class Optimiser:
    """Points that a tree-structured Parzen estimator asks for: `spec.trials` in all, `slots` at once.

    Trials of an earlier run are told to it first. With one worker the same seed gives the same points; with
    several, what is asked for depends on what is known by then.
    Source: Ozaki et al., "Multiobjective Tree-Structured Parzen Estimator", JAIR 2022.
    """

    def __init__(self, spec: Spec, base: Scene, results: Results, folder: Path, slots: int):
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        self.spec, self.base, self.results, self.slots = spec, base, results, slots
        self.folder, self.total = folder, spec.trials
        [self.axes] = spec.axes
        self.space = {
            axis: optuna.distributions.CategoricalDistribution(range(len(values)))
            for axis, values in self.axes.items()
        }
        self.asked: dict[int, tuple[optuna.trial.Trial, Point]] = {}
        rows, before = {row.key: row for row in results.rows()}, results.trials()
        # Another seed for each start: the same one would ask for the same first points again.
        self.study = optuna.create_study(
            directions=["minimize"] * len(spec.objectives),
            sampler=optuna.samplers.TPESampler(seed=spec.seed + len(before)),
        )
        for choice, key in before:
            self.study.add_trial(self._told(choice, rows.get(key)))
        self.count = len(before)

    def _values(self, row: Row | None) -> list[float] | None:
        """The objectives of a point; None where it has none."""
        if row is None or row.status != "done":
            return None
        for name in self.spec.objectives:
            if name not in row.metrics:
                raise ValueError(f"objectives: {name!r}: not measured; there are {', '.join(row.metrics)}")
        return [row.metrics[name] for name in self.spec.objectives]

    def _told(self, choice: dict, row: Row | None) -> optuna.trial.FrozenTrial:
        values = self._values(row)
        state = optuna.trial.TrialState.FAIL if values is None else optuna.trial.TrialState.COMPLETE
        return optuna.trial.create_trial(params=choice, distributions=self.space, values=values, state=state)

    def ask(self, under_way: int) -> Point | None:
        """The next point, chosen with what is known; None at the end, and while enough are under way."""
        if self.count >= self.spec.trials or under_way >= self.slots:
            return None
        trial = self.study.ask(self.space)
        choice = {}
        for axis, index in trial.params.items():
            choice |= expand(axis, self.axes[axis][index])
        point = point_of(self.base, choice, self.folder)
        self.asked[id(point)] = trial, point
        self.count += 1
        return point

    def tell(self, point: Point, row: Row) -> None:
        """What was found of a point that was asked for."""
        trial, _ = self.asked.pop(id(point))
        values = self._values(row)
        state = optuna.trial.TrialState.FAIL if values is None else None
        self.study.tell(trial, values, state=state)
        self.results.add_trial(trial.params, row.key)
