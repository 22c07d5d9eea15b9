"""Where an interrupted step goes on from: a file for one set of inputs and one state of the code."""

import os
import time

from fastac.store.checkpoint import checkpoint
from fastac.store.steps import Step
from fastac.store.store import DAY_S


def slopes(toy, value=2, **changes):
    return Step(
        "slopes", toy.function("slopes"), {"scene": toy.scene(**changes), "value": value}, ("slopes.txt",)
    )


def test_the_same_inputs_have_the_same_file(toy):
    path = checkpoint(toy.store(), slopes(toy))
    assert path == checkpoint(toy.store(), slopes(toy))
    assert path.parent.parent == toy.kept
    toy.edit("steps.py", "def slopes(", "# a comment\ndef slopes(")
    assert checkpoint(toy.store(), slopes(toy)) == path


def test_other_arguments_settings_or_code_have_another(toy):
    paths = [checkpoint(toy.store(), slopes(toy))]
    paths.append(checkpoint(toy.store(), slopes(toy, value=3)))
    paths.append(checkpoint(toy.store(), slopes(toy, solver="exact")))
    toy.edit("steps.py", "scene.numbers.slope_bits)))", "scene.numbers.slope_bits) + 1))")
    paths.append(checkpoint(toy.store(), slopes(toy)))
    assert len(set(paths)) == len(paths)


def test_the_content_of_the_steps_before_counts(toy):
    def doubled(value):
        source = slopes(toy, value=value).output("slopes.txt")
        return Step("doubled", toy.function("doubled"), {"source": source}, ("doubled.txt",))

    first, second = (checkpoint(toy.store(), doubled(value)) for value in (2, 3))
    assert first != second


def test_what_is_long_unused_is_cleaned(toy):
    old, new = (checkpoint(toy.store(), slopes(toy, value=value)) for value in (2, 3))
    old.parent.mkdir(parents=True)
    for path in (old, new):
        path.write_text("half")
    long_ago = time.time() - 3 * DAY_S
    os.utime(old, (long_ago, long_ago))
    toy.store().clean(2)
    assert not old.exists()
    assert new.exists()
