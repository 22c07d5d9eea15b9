import shutil

import pytest


@pytest.fixture(scope="module")
def folder(tiny_folder, tiny_file, tmp_path_factory):
    """A build folder that has made its own frames."""
    path = shutil.copytree(tiny_folder, tmp_path_factory.mktemp("studied") / "tiny")
    shutil.copy(tiny_file, path / "data.h5")
    return path
