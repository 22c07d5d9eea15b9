"""Touch in a LeRobotDataset as arrays, for recording loops of your own.

`lerobot-record` of LeRobot 0.4.4 cannot add arrays to a dataset; LeRobotDataset itself can:

    dataset = LeRobotDataset.create(…, features={**features, **tactile_features("tip", camera.taxels.count)})
    camera.async_read()
    dataset.add_frame({**frame, **tactile_frame("tip", camera.tactile())})
"""

import numpy as np

from .taxels import POINT_COLUMNS, WRENCH_COLUMNS


def tactile_features(name: str, taxels: int) -> dict[str, dict]:
    """The features of a fingertip for `LeRobotDataset.create`."""
    return {
        f"observation.tactile.{name}.points": {
            "dtype": "float32",
            "shape": (taxels, len(POINT_COLUMNS)),
            "names": list(POINT_COLUMNS),
        },
        f"observation.tactile.{name}.wrench": {
            "dtype": "float32",
            "shape": (len(WRENCH_COLUMNS),),
            "names": list(WRENCH_COLUMNS),
        },
    }


def tactile_frame(name: str, touch: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What `FastacCamera.tactile` gave, as part of a frame for `LeRobotDataset.add_frame`."""
    return {f"observation.tactile.{name}.{part}": values for part, values in touch.items()}
