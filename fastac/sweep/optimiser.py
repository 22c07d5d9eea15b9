"""Multi-objective design-space exploration: the points of a sweep that Optuna proposes; resumable."""

from pathlib import Path

import optuna

from fastac.scenes.schema import Scene
from fastac.sweep.results import Results, Row
from fastac.sweep.spec import Point, Spec, expand, point_of


class Optimiser:
    """Source of points proposed by a tree-structured Parzen estimator: `spec.trials` in all, `slots` at once.

    Trials of earlier runs are read from the results first. With one worker the same seed gives the same
    points; with several, a proposal depends on which results have arrived.
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
        # Another seed for each start: the same one would propose the same first points again.
        self.study = optuna.create_study(
            directions=["minimize"] * len(spec.objectives),
            sampler=optuna.samplers.TPESampler(seed=spec.seed + len(before)),
        )
        for choice, key in before:
            self.study.add_trial(self._finished_trial(choice, rows.get(key)))
        self.count = len(before)

    def _values(self, row: Row | None) -> list[float] | None:
        """The objectives of a point; None unless it is done.

        Raises ValueError for an objective that is not among the metrics.
        """
        if row is None or row.status != "done":
            return None
        for name in self.spec.objectives:
            if name not in row.metrics:
                raise ValueError(f"objectives: {name!r}: not measured; there are {', '.join(row.metrics)}")
        return [row.metrics[name] for name in self.spec.objectives]

    def _finished_trial(self, choice: dict, row: Row | None) -> optuna.trial.FrozenTrial:
        """A trial of an earlier run; failed where its row has no objectives."""
        values = self._values(row)
        state = optuna.trial.TrialState.FAIL if values is None else optuna.trial.TrialState.COMPLETE
        return optuna.trial.create_trial(params=choice, distributions=self.space, values=values, state=state)

    def ask(self, under_way: int) -> Point | None:
        """The next point; None after the last, and while `slots` points are under way."""
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
        """Record the result of a point that `ask` returned."""
        trial, _ = self.asked.pop(id(point))
        values = self._values(row)
        state = optuna.trial.TrialState.FAIL if values is None else None
        self.study.tell(trial, values, state=state)
        self.results.add_trial(trial.params, row.key)
