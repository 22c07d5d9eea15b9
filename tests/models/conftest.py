import pytest
import torch


@pytest.fixture(autouse=True, scope="session")
def one_thread():
    """Torch on one thread, as in training: networks this small lose more by handing work over."""
    torch.set_num_threads(1)
