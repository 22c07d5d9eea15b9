"""Imports the ball presses of a Taxim calibration as a dataset.

The layout is the data pack that Taxim's calibration/generateDataPack.py writes (GitHub, Robo-Touch/Taxim), an
.npz with these arrays:

    f0              (height, width, 3) uint8, the untouched gel, in the order B, G, R, as all photographs
    imgs            (presses, height, width, 3) uint8, the photographs
    touch_center    (presses, 2), centers of the contact circles, x and y, px
    touch_radius    (presses,), their radii, px
    names           (presses,) text, the photographs' file names; each press is a group of this name

The pack names no split: every fifth press is a test, or those that are held out.
"""

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from fastac.sensor.importers.contact_circles import Press, splits_of, write_presses
from fastac.sensor.importers.footage import ImportFailure, check_scale, one_line
from fastac.store.files import load_arrays

MOST_BYTES = 1 << 31
"""Of a pack's arrays: two thousand photographs of 640 × 480 px."""


def import_pack(
    pack: Path | str,
    *,
    ball_mm: float,
    px_per_mm: float,
    output: Path | str,
    held_out: tuple[str, ...] = (),
    **settings,
) -> None:
    """Import the presses of a data pack (see above) into the dataset `output`.

    held_out : presses of the test split, by their names such as frame_4.jpg; without it every fifth press is
    settings : of `contact_circles.write_presses`: size, circles, progress

    What the dataset holds, sensor/importers/contact_circles.py says. Raises ImportFailure on anything
    missing, unreadable or inconsistent.
    """
    pack = Path(pack)
    check_scale(pack, "ball_mm", ball_mm)
    check_scale(pack, "px_per_mm", px_per_mm)
    arrays = _arrays(pack)
    names = arrays["names"].tolist()
    repeated = [name for name in names if names.count(name) > 1]
    if repeated:
        raise ImportFailure(f"{pack}: names: {repeated[0]!r} is there {names.count(repeated[0])} times")
    presses = []
    for k, (name, split) in enumerate(zip(names, splits_of(pack, names, held_out), strict=True)):
        place = f"{pack}: {name}"
        circle = *map(float, arrays["touch_center"][k]), float(arrays["touch_radius"][k])
        read = partial(np.asarray, arrays["imgs"][k])
        presses.append(Press(read, place, place, *circle, ball_mm, split, name))
    write_presses(
        presses,
        arrays["f0"],
        px_per_mm=px_per_mm,
        source=f"recorded: Taxim data pack {pack.name}",
        output=output,
        **settings,
    )


def _arrays(pack: Path) -> Mapping[str, np.ndarray]:
    """The arrays of a pack. Raises ImportFailure for any that is missing or of another kind or shape."""
    with one_line(pack):
        arrays = load_arrays(pack, most_bytes=MOST_BYTES)
    if "imgs" not in arrays or arrays["imgs"].ndim != 4 or not len(arrays["imgs"]):
        raise ImportFailure(f"{pack}: imgs: expected photographs, (presses, height, width, 3) uint8")
    count, *shape = arrays["imgs"].shape
    expected = {
        "f0": ("u1", (*shape[:2], 3)),
        "imgs": ("u1", (count, *shape[:2], 3)),
        "touch_center": ("iuf", (count, 2)),
        "touch_radius": ("iuf", (count,)),
        "names": ("U", (count,)),
    }
    for key, (kinds, size) in expected.items():
        if key not in arrays:
            raise ImportFailure(f"{pack}: {key}: missing array")
        value = arrays[key]
        of_kind = value.dtype == np.uint8 if kinds == "u1" else value.dtype.kind in kinds
        if value.shape != size or not of_kind:
            what = {"u1": "uint8", "iuf": "numbers", "U": "text"}[kinds]
            raise ImportFailure(
                f"{pack}: {key} = {value.dtype} of shape {value.shape}: expected {what} of shape {size}"
            )
        if kinds == "iuf" and not np.isfinite(value).all():
            raise ImportFailure(f"{pack}: {key}: not all are finite")
    return arrays
