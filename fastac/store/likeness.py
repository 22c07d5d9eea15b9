"""Steps that would give the same result, told without performing them, for those who plan many steps."""

from pathlib import Path

from fastac.store.digest import encoded, path_digest
from fastac.store.files import content_hash
from fastac.store.recording import unrecorded
from fastac.store.steps import Output, Step, is_settings, leaves, normalised
from fastac.store.store import Store


def likeness(store: Store, step: Step) -> str | None:
    """A hash that steps share if they differ in nothing that the last run of such a step has read.

    None while no step of this name has run, so that nobody knows what it reads. A guess, good for planning:
    another run may read more. `Store.perform` does not rely on it.
    """
    latest = store.latest(step)
    if latest is None:
        return None
    parts = {}
    for argument, value in step.arguments.items():
        for place, leaf in leaves(value, argument):
            if isinstance(leaf, Output):
                parts[place] = [likeness(store, leaf.step), leaf.name]
                if parts[place][0] is None:
                    return None
            elif isinstance(leaf, Path):
                parts[place] = path_digest(leaf)
            elif is_settings(leaf):
                parts[place] = _values(leaf, latest.trace["reads"].get(place, {}))
            else:
                parts[place] = encoded(normalised(leaf, step.name, place))
    return content_hash(step.code, parts)


def _values(settings, paths) -> dict:
    found = {}
    with unrecorded():
        for path in paths:
            try:
                found[path] = encoded(settings.unwatched().value_at(path))
            except Exception as error:  # a rule may raise anything for settings it does not fit
                found[path] = {"missing": type(error).__name__}
    return found
