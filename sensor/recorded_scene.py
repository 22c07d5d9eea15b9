"""A recorded scene's image has the size and the pitch of its recording.

Photographs are resampled to the size and the pitch that their importer was asked for, and another sensor has
another scale; the scene says everything else.
"""

from pathlib import Path

from pydantic import ValidationError

from fastac.scenes.schema import Scene, describe
from fastac.sensor import dataset
from fastac.sensor.optics.mosaic import CELL
from fastac.sensor.samples import PITCH_TOLERANCE, DatasetError

SIZE, PITCH = ("height_px", "width_px"), "pitch_mm"


def of_recording(scene: Scene, path: Path | str) -> tuple[Scene, dict[str, tuple[float, float]]]:
    """The scene with the size and the pitch of the dataset in a file; and what was changed, by key of
    `sensor`: the scene's value and the dataset's.

    A scene whose frames are simulated stays as it is, and so does a pitch that differs by rounding alone.
    Raises DatasetError for a file that is no dataset, and for a size that no scene can have.
    """
    sensor = scene.sensor
    if sensor.source != "recorded":
        return scene, {}
    data = dataset.read(path)
    cell_px = 1 if data.raw10 is None else CELL
    recorded = {key: side // cell_px for key, side in zip(SIZE, data.background.shape[:2], strict=True)}
    if abs(data.pitch_mm / sensor.pitch_mm - 1) > PITCH_TOLERANCE:
        recorded[PITCH] = float(f"{data.pitch_mm:.6g}")
    changed = {
        key: (getattr(sensor, key), value) for key, value in recorded.items() if getattr(sensor, key) != value
    }
    if not changed:
        return scene, {}
    content = scene.model_dump(mode="json")
    content["sensor"] |= {key: value for key, (_, value) in changed.items()}
    try:
        return Scene.model_validate(content), changed
    except ValidationError as error:
        raise DatasetError(f"{path}: {describe(error)}") from None
