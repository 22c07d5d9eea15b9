"""Miniature recordings in the layouts of other projects, a few small pictures each."""

import io
import pickle
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from fastac.sensor.importers.footage import ImportFailure

GS_SDK_PRESSES = {"4.000mm/0": 4.0, "4.000mm/1": 4.0, "6.500mm/0": 6.5}


def refused_by(imported, folder: Path, *others, **changed) -> str:
    """The one line with which a test's function `imported` fails; out.h5 beside the folder is not written."""
    with pytest.raises(ImportFailure) as error:
        imported(folder, *others, **changed)
    assert "\n" not in str(error.value)
    assert not (folder.parent / "out.h5").exists()
    return str(error.value)


def gs_sdk_folder(folder: Path) -> Path:
    """A calibration of gs_sdk: three presses of two balls, 64 px wide and 48 px high."""
    for k, name in enumerate(GS_SDK_PRESSES):
        (folder / name).mkdir(parents=True)
        Image.new("RGB", (64, 48), (200, 100, 50 + k)).save(folder / name / "gelsight.png")
        np.savez(folder / name / "label.npz", center=[30 + k, 24.5], radius=12)
    rows = "".join(f"{name},{ball}\n" for name, ball in GS_SDK_PRESSES.items())
    (folder / "catalog.csv").write_text("experiment_reldir,diameter(mm)\n" + rows)
    Image.new("RGB", (64, 48), (90, 80, 70)).save(folder / "background.png")
    return folder


def fots_folder(folder: Path) -> Path:
    """A calibration of FOTS: five presses, labelled on another machine, 48 px wide and 64 px high."""
    (folder / "gelsight").mkdir(parents=True)
    (folder / "csv").mkdir()
    rows = ""
    for k in range(5):
        Image.new("RGB", (48, 64), (200, 100, 50 + k)).save(folder / "gelsight" / f"{k + 1:04d}.png")
        rows = f"/home/a/gelsight/{k + 1:04d}.png,{20 + k},30,12\n" + rows
    (folder / "csv" / "annotate.csv").write_text("img_names,center_x,center_y,radius\n" + rows)
    Image.new("RGB", (48, 64), (90, 80, 70)).save(folder / "0000.png")
    return folder


def taxim_pack(folder: Path) -> Path:
    """A folder with dataPack.npz, a calibration of Taxim: five presses, 64 px wide and 48 px high."""
    folder.mkdir(parents=True)
    photographs = np.full((5, 48, 64, 3), (50, 100, 200), np.uint8)
    photographs[..., 0] += np.arange(5, dtype=np.uint8)[:, None, None]
    np.savez(
        folder / "dataPack.npz",
        f0=np.full((48, 64, 3), (70, 80, 90), np.uint8),
        imgs=photographs,
        touch_center=[(30 + k, 24.5) for k in range(5)],
        touch_radius=[12] * 5,
        names=[f"frame_{k + 1}.jpg" for k in range(5)],
        img_size=(48, 64, 3),
    )
    return folder


GEL = (70, 80, 90)
"""Red, green and blue of the untouched skin in recordings with forces."""


def pressed(load_n: float, height: int = 48, width: int = 64) -> np.ndarray:
    """A picture (height, width, 3) uint8, R, G, B, that is the brighter the larger the load."""
    picture = np.full((height, width, 3), GEL, np.uint8)
    picture[height // 4 : height // 2, width // 4 : width // 2] += np.uint8(10 * load_n)
    return picture


def feats_folder(folder: Path) -> Path:
    """Six frames of FEATS of three indenters, in train, val and test, beside rest.npy, the untouched gel."""
    for k in range(6):
        place = folder / ("train", "train", "train", "val", "test", "test")[k]
        place.mkdir(parents=True, exist_ok=True)
        force = {"f_x": np.float64(0.1), "f_y": -0.2, "f_z": np.float64(-1.0 - k)}
        label = {"gs_img": pressed(1 + k), "grid_z": np.zeros((24, 32)), **force}
        np.save(place / f"{k}_1744012609_{('cuboid_10', 'sphere_6', 'ring')[k // 2]}.npy", label)
    np.save(folder / "rest.npy", {"gs_img": pressed(0)})
    return folder


def encoded(picture: np.ndarray, kind: str = "PNG") -> bytes:
    file = io.BytesIO()
    Image.fromarray(picture).save(file, kind)
    return file.getvalue()


def estimate_modulus_folder(folder: Path) -> Path:
    """Three grasps of two objects in the layout of EstimateModulus: two frames at rest, then four that are
    pressed ever harder, without loss. The second grasp's light is 6 levels brighter."""
    folder.mkdir(parents=True)
    loads = [0, 0, 1, 2, 3, 4]
    for name, brighter in (("golf_ball__t=0", 0), ("golf_ball__t=1", 6), ("foam_brick__t=0", 0)):
        with av.open(str(folder / f"{name}.avi"), "w") as container:
            stream = container.add_stream("ffv1", rate=30)
            stream.width, stream.height, stream.pix_fmt = 64, 48, "bgr0"
            for load in loads:
                picture = pressed(load) + np.uint8(brighter)
                container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
            container.mux(stream.encode())
        (folder / f"{name}_forces.pkl").write_bytes(pickle.dumps([float(load) for load in loads]))
    return folder


def tacbench_folder(folder: Path) -> Path:
    """Two batches of TacBench: three images at rest, then strokes of three and of four, in two files each.

    The second batch's light is 6 levels brighter. The load of an image is its number in the stroke, from 1 N.
    """
    for batch, brighter in (("sphere/batch_1", 0), ("flat/batch_2", 6)):
        (folder / batch).mkdir(parents=True)
        loads = [0, 0, 0, 1, 2, 3, 1, 2, 3, 4]
        images = [encoded(pressed(load) + np.uint8(brighter)) for load in loads]
        images[1] = pressed(0) + np.uint8(brighter)
        for k, part in enumerate((images[:4], images[4:])):
            (folder / batch / f"dataset_digit_{k:02d}.pkl").write_bytes(pickle.dumps(part))
        strokes = {
            name: {
                "indexes": indexes,
                "forces": np.array([(0.5, -0.25, loads[k]) for k in indexes]),
                "slip_label": np.zeros(len(indexes)),
            }
            for name, indexes in ((0, [3, 4, 5]), (1, np.arange(6, 10)))
        }
        labels = {"in_contact": np.sign(loads), "trajectories": strokes}
        (folder / batch / "dataset_slip_forces.pkl").write_bytes(pickle.dumps(labels))
    return folder
