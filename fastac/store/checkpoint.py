"""Where a step that can be interrupted keeps how far it has come."""

from pathlib import Path

from fastac.store.files import content_hash
from fastac.store.steps import Step, needed_steps
from fastac.store.store import CHECKPOINTS, Store
from fastac.store.traces import Inputs


def checkpoint(store: Store, step: Step) -> Path:
    """A file of the step's own, another one wherever its arguments, any of its settings or its code differ.

    The steps before it are performed. The step's function removes the file when it has done its work. What
    it looks up in tables of kinds does not count: it should look up nothing there.
    """
    needed = {other: store.perform(other) for other in needed_steps(step)}
    inputs = Inputs.of(step, needed)
    store.code.refresh()
    schemas = {type(settings.unwatched()) for settings in inputs.settings.values()}
    names = sorted(f"{schema.__module__}:{schema.__qualname__}" for schema in schemas)
    codes = [store.code.closure(start).digest for start in (step.code, *names)]
    return store.folder / CHECKPOINTS / f"{step.name}-{content_hash(inputs.run, codes)[:24]}.npz"
