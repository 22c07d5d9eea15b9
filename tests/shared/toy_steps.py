"""Steps of the toy project of tests/fastac/store/conftest.py, by what they read."""

from fastac.store.steps import Step


def slopes(toy, **changes) -> Step:
    return Step("slopes", toy.function("slopes"), {"scene": toy.scene(**changes)}, ("slopes.txt",))


def weights(toy, **changes) -> Step:
    return Step("weights", toy.function("weights"), {"scene": toy.scene(**changes)}, ("weights.txt",))


def solved(toy, **changes) -> Step:
    return Step("solved", toy.function("solved"), {"scene": toy.scene(**changes)})


def states(toy, step) -> list[tuple[str, str]]:
    seen = []
    toy.store().perform(step, lambda name, state: seen.append((name, state)))
    return seen
