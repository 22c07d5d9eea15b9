"""Miniature recordings in the layouts of other projects, a few small pictures each."""

from pathlib import Path

import numpy as np
from PIL import Image

GS_SDK_PRESSES = {"4.000mm/0": 4.0, "4.000mm/1": 4.0, "6.500mm/0": 6.5}


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
