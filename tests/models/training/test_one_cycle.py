import pytest
import torch

from fastac.models.training.one_cycle import SHORT, one_cycle


@pytest.mark.parametrize("steps", [1, 2, SHORT, SHORT + 1, 200])
def test_rates_rise_and_are_annealed_over_all_steps(steps):
    """Also where a tenth of the steps is less than one."""
    parameters = [torch.nn.Parameter(torch.zeros(1)) for _ in range(2)]
    optimiser = torch.optim.SGD([{"params": [p], "lr": 1.0} for p in parameters])
    schedule, seen = one_cycle(optimiser, [0.1, 0.2], steps), []
    for _ in range(steps):
        seen.append(schedule.get_last_lr())
        optimiser.step()
        schedule.step()
    first, second = zip(*seen, strict=True)
    assert second == pytest.approx([2 * rate for rate in first])
    assert 0 < min(first) <= max(first) <= 0.1
    if steps == 200:
        assert max(first) == pytest.approx(0.1, rel=1e-3)
        assert first.index(max(first)) == 19
    if steps > 1:
        assert first[-1] < 0.01 * max(first)
