"""What losses, fewer pixels at rest and several shapes in training are worth: forces on new objects, μ.

A small virtual fingertip is trained in several ways on equally many presses. Each way's forces on objects
that no way was trained on are measured (fastac/studies/shapes/study.py), and the friction that the grasp's
slip test finds on a bottle (fastac/studies/demos/grasp.py). Everything is simulated.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

from fastac.flow.build import Build
from fastac.models.integer import bundle as bundles
from fastac.report.tables import Table, mean_and_spread
from fastac.scenes.schema import AXES, Scene
from fastac.sensor.mechanics.rig import rig_of
from fastac.store.files import read_json, write_json
from fastac.studies.demos.bottle import Grasp
from fastac.studies.demos.grasp import slip_test
from fastac.studies.shapes import study

STILL_SHARE, HUBER_DELTA, DEPTH_WEIGHT = 0.1, 0.1, 0.5
SHAPES = ("cylinder", "edge", "punch", "lump")
WAYS: Mapping[str, dict] = {
    "balls, all pixels": {},
    "balls, all pixels, huber_delta": {"training": {"huber_delta": HUBER_DELTA}},
    "balls, all pixels, depth_weight": {"training": {"depth_weight": DEPTH_WEIGHT}},
    "balls": {"training": {"still_share": STILL_SHARE}},
    "shapes but cylinders": {
        "protocol": {"more_shapes": SHAPES[1:]},
        "training": {"still_share": STILL_SHARE},
    },
    "shapes": {"protocol": {"more_shapes": SHAPES}, "training": {"still_share": STILL_SHARE}},
}
"""Ways to train: what differs from `scene_of`, by table of the scene."""


def scene_of(way: str, seed: int) -> Scene:
    """scenes/fingertip.toml at 64 × 64 pixels, on a coarser mesh, with fewer and larger dots and fewer
    presses, without RAW10 frames; trained in one of WAYS."""
    changes = WAYS[way]
    return Scene.model_validate(
        {
            "name": f"{way.replace(',', '').replace(' ', '-')}-{seed}",
            "outputs": ["depth", "force_xyz"],
            "sensor": {
                "geometry": "fingertip",
                "height_px": 64,
                "width_px": 64,
                "pitch_mm": 0.25,
                "elastomer": {"mechanics": "fem", "friction": 1.0, "elements": 24, "layers": 3},
                "markers": {"spacing_mm": 2.0, "radius_mm": 0.5},
            },
            "protocol": {
                "train_grid": 5,
                "validation_grid": 3,
                "test_grid": 4,
                "more_balls_mm": [10.0, 20.0],
                **changes.get("protocol", {}),
            },
            "network": {"bridge_dots": True},
            "numbers": {"activation_bits": 10, "kernel_bits": 16},
            "poisson": {"solver": "tridiagonal"},
            "force": {
                "dots": True,
                "fit": "weights",
                "kernel": "collapsed",
                "band_mm": 0.01,
                "deep_mm": 0.2,
            },
            "hardware": {"weights": "baked"},
            "training": {
                "normals_epochs": 8,
                "finetune_epochs": 4,
                "seed": seed,
                **changes.get("training", {}),
            },
        }
    )


def measure(
    folder: Path, *, ways: Sequence[str] = tuple(WAYS), seeds: int = 2, count: int = 40, progress: bool = True
) -> dict:
    """Train each way with each seed, measure; writes mixtures.json into `folder`, returns its content.

    count : objects of each kind. Builds, and the store that lets an interrupted run go on, lie in `folder`.
    """
    named, tests, known = {}, {}, {}
    for way in ways:
        for seed in range(1, seeds + 1):
            scene = scene_of(way, seed)
            build = Build(scene, folder / scene.name, progress=progress)
            build.run(lambda name, state: None, until="evaluate")
            bundle = named[scene.name] = bundles.load(build.folder / "bundle")
            known[scene.name] = read_json(build.folder / "accuracy.json")["integer"]
            rig = rig_of(scene.sensor, build.store, progress=progress)
            tests[scene.name] = slip_test(bundle, rig, Grasp().of_scene(scene), progress=progress)
    found = study.run(named, folder, count=count, store=folder / "store", progress=progress)
    content = {
        "source": "simulated",
        "seeds": seeds,
        "objects": count,
        "friction": scene.sensor.elastomer.friction,
        "ways": {way: [scene_of(way, seed).name for seed in range(1, seeds + 1)] for way in ways},
        "slip_test": tests,
        "known_ball": known,
        "by_kind": found["by_kind"],
    }
    write_json(folder / "mixtures.json", content)
    return content


def tables(content: dict) -> list[Table]:
    """By way: the slip test's μ and errors on the known ball; by kind of object and way: errors and bias."""
    first, second = [], []
    for way, names in content["ways"].items():
        ball = [content["known_ball"][name] for name in names]
        first.append(
            [
                way,
                mean_and_spread([content["slip_test"][name]["found_ratio"] for name in names], 2),
                *(mean_and_spread([1e3 * one[f"force_{axis}_mae_n"] for one in ball], 0) for axis in AXES),
                mean_and_spread([1e3 * one["depth_mae_mm"] for one in ball], 1),
            ]
        )
    for kind, found in content["by_kind"].items():
        for way, names in content["ways"].items():
            of_way = [found[name] for name in names]
            second.append(
                [
                    kind,
                    way,
                    *(mean_and_spread([1e3 * one["mae_n"][axis] for one in of_way], 0) for axis in AXES),
                    *(
                        mean_and_spread([one["gain"][axis] for one in of_way], 2)
                        for axis in ("shear", "normal")
                    ),
                    mean_and_spread([one["friction_ratio"] for one in of_way], 2),
                ]
            )
    errors = [f"error F_{axis}, mN" for axis in AXES]
    note = f"mean ± standard deviation over {content['seeds']} trainings; simulated"
    return [
        Table(
            f"A bottle's friction, in truth {content['friction']:g}, and the 5 mm ball's held-out presses",
            ["trained on", "μ of the slip test", *errors, "error depth, µm"],
            first,
            note,
        ),
        Table(
            f"{content['objects']} new objects of each kind",
            ["object", "trained on", *errors, "found/true: shear", "F_z", "F_s/F_n"],
            second,
            note,
        ),
    ]
