"""What several tests share: a sensor of 16×16 px, frames from it, and its models, trained in two seconds."""

import os
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest
from filelock import FileLock

from fastac.sweep.pools import single_threaded

WORKERS = "PYTEST_XDIST_WORKER" in os.environ
if WORKERS:
    # Each worker has a core; threads of PyTorch and BLAS beside it would wait for one another by spinning.
    single_threaded()

from fastac.scenes.schema import Scene  # noqa: E402  imports NumPy, which reads the variables

TINY = """\
name = "tiny"
outputs = ["normals", "depth", "force_z"]

[sensor]
geometry = "fingertip"
height_px = 16
width_px = 16
pitch_mm = 0.25
channels = "bgr+nir"
ellipsoid = { semi_axes_mm = [4.0, 5.0, 3.0] }
elastomer = { rim_mm = 0.5, thickness_mm = 2.0 }

[protocol]
train_grid = 3
validation_grid = 2
test_grid = 2
loads_n = [0.03, 0.06]
ball_mm = 1.5

[numbers]
displacement_bits = 16

[poisson]
mode = "absolute"

[training]
normals_epochs = 15
normals_batch_px = 256
finetune_epochs = 3
force_epochs = 5
"""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Mark cases as `full` or `mutate` by `quick(id, …, mutate=[id, …])`, and put `long` tests first.

    Begun last, a long test would run alone on one core at the end.
    """
    items.sort(key=lambda item: item.get_closest_marker("long") is None)
    unknown = {}
    for item in items:
        marker = item.get_closest_marker("quick")
        if marker is None:
            continue
        further = set(marker.kwargs.get("mutate", ()))
        named = set(marker.args) | further
        unknown.setdefault(item.nodeid.split("[")[0], named).discard(item.callspec.id)
        if item.callspec.id not in marker.args:
            item.add_marker(pytest.mark.full)
        if item.callspec.id in further:
            item.add_marker(pytest.mark.mutate)
    whole = not any("::" in argument for argument in config.args)
    if whole and any(unknown.values()):
        wrong = "; ".join(f"{name}: {sorted(ids)}" for name, ids in unknown.items() if ids)
        raise pytest.UsageError(f"pytest.mark.quick names cases that do not exist: {wrong}")


def _merge(content: dict, changes: dict) -> dict:
    merged = dict(content)
    for key, value in changes.items():
        nested = isinstance(value, dict) and isinstance(content.get(key), dict)
        merged[key] = _merge(content[key], value) if nested else value
    return merged


@pytest.fixture(scope="session")
def made_once(tmp_path_factory) -> Callable[[str, Callable[[Path], None]], Path]:
    """`made_once(name, make)`: a folder that `make` fills, for all of pytest's workers together."""
    base = tmp_path_factory.getbasetemp()
    common = (base.parent if WORKERS else base) / "made_once"
    common.mkdir(exist_ok=True)

    def folder(name: str, make: Callable[[Path], None]) -> Path:
        place, done = common / name, common / f"{name}.done"
        with FileLock(common / f"{name}.lock"):
            if not done.exists():
                shutil.rmtree(place, ignore_errors=True)  # of a worker that could not make it
                place.mkdir()
                make(place)
                done.touch()
        return place

    return folder


@pytest.fixture(scope="session")
def dataset_of(made_once) -> Callable[..., Path]:
    """`dataset_of(scene, **options)`: a scene's frames, under its name, with options of `generate`."""
    from fastac.sensor.fingertip import generate

    def file(scene: Scene, **options) -> Path:
        def make(folder: Path) -> None:
            generate(scene, folder / f"{scene.name}.h5", progress=False, processes=1, **options)

        return made_once(f"{scene.name}_frames", make) / f"{scene.name}.h5"

    return file


@pytest.fixture(scope="session")
def build_of(made_once) -> Callable[[Scene, Path], Path]:
    """`build_of(scene, data)`: a build folder, under the scene's name, with everything up to the bundle."""
    from fastac.flow.build import Build

    def build_folder(scene: Scene, data: Path) -> Path:
        def make(folder: Path) -> None:
            build = Build(scene, folder / scene.name, data, progress=False)
            build.run(lambda name, current: None, until="bundle")

        return made_once(f"{scene.name}_build", make) / scene.name

    return build_folder


@pytest.fixture(scope="session")
def tiny_toml() -> str:
    return TINY


@pytest.fixture(scope="session")
def make_scene():
    """The tiny scene with changes: `make_scene(outputs=["normals"], poisson={"mode": "difference"})`."""
    return lambda **changes: Scene.model_validate(_merge(tomllib.loads(TINY), changes))


@pytest.fixture(scope="session")
def tiny_scene(make_scene) -> Scene:
    return make_scene()


@pytest.fixture(scope="session")
def tiny_file(tiny_scene, dataset_of) -> Path:
    """A dataset of 18 train, 8 validation and 8 test presses. Not to be changed."""
    return dataset_of(tiny_scene)


@pytest.fixture(scope="session")
def tiny_data(tiny_file, tiny_scene):
    from fastac.sensor.dataset import read

    return read(tiny_file, tiny_scene)


@pytest.fixture(scope="session")
def tiny_folder(tiny_scene, tiny_file, build_of) -> Path:
    """A build folder with everything up to the bundle. Not to be changed: copy it."""
    return build_of(tiny_scene, tiny_file)


@pytest.fixture(scope="session")
def tiny_bundle(tiny_folder):
    from fastac.models.integer import bundle

    return bundle.load(tiny_folder / "bundle")


@pytest.fixture(scope="session")
def dotted_scene(make_scene) -> Scene:
    """The tiny scene with twice the pixels and 3 × 3 dots, which bridge slopes and join the force; bends."""
    pixels = {"height_px": 32, "width_px": 32, "pitch_mm": 0.125}
    force = {
        "dots": True,
        "fit": "weights",
        "kernel": "collapsed",
        "clamp": False,
        "band_mm": 0.002,
        "deep_mm": 0.01,
    }
    return make_scene(
        name="dotted",
        sensor={**pixels, "markers": {"spacing_mm": 1.0, "radius_mm": 0.2}},
        network={"bridge_dots": True},
        numbers={"kernel_bits": 16},
        force=force,
        training={"normals_epochs": 6},
    )


@pytest.fixture(scope="session")
def dotted_file(dotted_scene, dataset_of) -> Path:
    """A dataset of that scene. Not to be changed."""
    return dataset_of(dotted_scene)


@pytest.fixture(scope="session")
def dotted_data(dotted_file, dotted_scene):
    from fastac.sensor.dataset import read

    return read(dotted_file, dotted_scene)


@pytest.fixture(scope="session")
def dotted_folder(dotted_scene, dotted_file, build_of) -> Path:
    """A build folder of that scene with everything up to the bundle. Not to be changed."""
    return build_of(dotted_scene, dotted_file)


@pytest.fixture(scope="session")
def dotted_bundle(dotted_folder):
    from fastac.models.integer import bundle

    return bundle.load(dotted_folder / "bundle")


@pytest.fixture(scope="session")
def tiny_rig_scene(make_scene) -> Scene:
    """The tiny scene on finite elements with friction, three axes of force."""
    gel = {"mechanics": "fem", "friction": 0.8, "elements": 12, "layers": 1}
    return make_scene(name="tiny_rig", outputs=["force_xyz"], sensor={"elastomer": gel})


@pytest.fixture(scope="session")
def tiny_rig_cache(made_once) -> Path:
    """A folder for the compliance of that scene's gel."""
    return made_once("tiny_rig_cache", lambda folder: None)


@pytest.fixture(scope="session")
def tiny_rig_folder(tiny_rig_scene, tiny_rig_cache, dataset_of, build_of) -> Path:
    """A build folder of that scene with everything up to the bundle. Not to be changed."""
    return build_of(tiny_rig_scene, dataset_of(tiny_rig_scene, store=tiny_rig_cache))


@pytest.fixture(scope="session")
def tiny_rig_bundle(tiny_rig_folder):
    from fastac.models.integer import bundle

    return bundle.load(tiny_rig_folder / "bundle")


@pytest.fixture(scope="session")
def slip_bundle(dotted_bundle):
    """The dotted bundle on finite elements with friction, with the output slip; its forces are random."""
    from dataclasses import replace

    import numpy as np

    from fastac.models.integer.assemble import with_force
    from fastac.models.random_bundle import force_weights

    changes = {
        "name": "slip",
        "outputs": ["force_xyz", "slip"],
        "slip": {"contact_mm": 0.002, "limit_px": 0.1},
    }
    content = dotted_bundle.scene.model_dump(mode="json") | changes
    content["sensor"]["elastomer"] |= {"mechanics": "fem", "friction": 0.8, "elements": 12, "layers": 1}
    scene, known = Scene.model_validate(content), dotted_bundle.pipeline
    weights = force_weights(scene, np.random.default_rng(1), known.follower)
    return replace(dotted_bundle, pipeline=with_force(known.replace(scene=scene), *weights))
