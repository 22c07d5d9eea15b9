"""What the tests of the site share."""

import pytest

from fastac.models.random_bundle import random_bundle
from fastac.models.random_bundle import scene as random_scene
from fastac_docs.graph import Graph, datapath_graph


@pytest.fixture(scope="session")
def small_bundle(tmp_path_factory):
    """Depth and force of a curved sensor of 16×16 pixels, the paper's solver, two pixels a clock."""
    scene = random_scene(("depth", "force_z"), lanes=2)
    return random_bundle(tmp_path_factory.mktemp("docs"), scene)


@pytest.fixture(scope="session")
def small_graph(small_bundle) -> Graph:
    return datapath_graph(small_bundle.pipeline)
