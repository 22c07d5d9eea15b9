"""Trials side by side: the best is kept, whichever process had it."""

import os

import pytest
import torch

from fastac.models.training.whole_frames.trials import Outcome, best_trial


class Killer:
    """Ends the process that unpickles it."""

    def __reduce__(self):
        return os._exit, (1,)


def outcome(trial: int, label: str, progress: bool) -> Outcome:
    """Of losses 3, 1, 2, 1."""
    return Outcome([3.0, 1.0, 2.0, 1.0][trial], {}, [{"label": label, "threads": torch.get_num_threads()}])


def test_the_first_of_the_smallest_losses_is_kept():
    found = best_trial(outcome, outcome, 4, 1, progress=False)
    assert found.loss == 1.0
    assert found.history == [{"label": ", trial 2 of 4", "threads": 1}]


def test_no_more_processes_than_trials():
    assert best_trial(outcome, None, 1, 8, progress=False).loss == 3.0


@pytest.mark.full  # another process takes seconds to start
class TestSideBySide:
    def test_other_processes_have_their_shares(self):
        """Their loss is the number of the trial, and here it is 5."""
        found = best_trial(lambda *_: Outcome(5.0, {}, []), Outcome, 4, 2, progress=False)
        assert (found.loss, found.arrays) == (1, ", trial 2 of 4")

    def test_what_a_killed_process_leaves_is_done_here(self):
        assert best_trial(outcome, Killer(), 4, 2, progress=False).history[0]["label"] == ", trial 2 of 4"

    def test_errors_pass_through(self):
        with pytest.raises(TypeError):
            best_trial(outcome, len, 4, 2, progress=False)
