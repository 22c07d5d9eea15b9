"""Where a step that can be interrupted keeps how far it has come."""

from pathlib import Path

from fastac.store.files import content_hash
from fastac.store.steps import Output, Step, leaves
from fastac.store.store import Store
from fastac.store.traces import Inputs

FOLDER = ".checkpoints"
"""In the store's folder."""


def checkpoint(store: Store, step: Step) -> Path:
    """A file of the step's own, another one wherever its arguments, any of its settings or its code differ.

    The steps before it are performed. The step's function removes the file when it has done its work. What
    it looks up in tables of kinds does not count: it should look up nothing there.
    """
    found = [leaf for name, value in step.arguments.items() for _, leaf in leaves(value, name)]
    needed = {leaf.step: store.perform(leaf.step) for leaf in found if isinstance(leaf, Output)}
    inputs = Inputs.of(step, needed)
    store.code.refresh()
    schemas = {type(settings.unwatched()) for settings in inputs.settings.values()}
    names = sorted(f"{schema.__module__}:{schema.__qualname__}" for schema in schemas)
    codes = [store.code.closure(start).digest for start in (step.code, *names)]
    return store.folder / FOLDER / f"{step.name}-{content_hash(inputs.run, codes)[:24]}.npz"
