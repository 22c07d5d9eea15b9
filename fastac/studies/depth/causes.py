"""What may make depth false: trainings that differ from the one as recorded in one thing each."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from fastac.models.integer.smoothing import WINDOWS_PX

AS_RECORDED = "as recorded"
MENDED = "circle_margin and flat_beyond"
PIXEL_MM = 0.13
"""A pixel of the image, and 2.5 of the photograph that circles are drawn in."""

WHOLE_EPOCHS = 4
"""Of a training on the whole skin, which has 15 times as many pixels: about as many steps as on circles."""


LIKE_GELSIGHT = {"circle_margin": 0.1, "flat_fraction": 0.05}
"""Keys of training that scenes/gelsight.toml has, too, beside levelled light."""


@dataclass(frozen=True)
class Cause:
    """A training, and what is evaluated of it.

    conditions : other values of `presses.Conditions`; training : of the scene's keys of training
    everywhere : whether the whole skin is labelled; slope_limit : another limit behind the same network
    level_light : whether frames are levelled, as with the scene key sensor.level_light
    smoothing_px : the window over which the network's input is averaged, as with network.smoothing_px
    """

    name: str
    conditions: dict[str, object] = field(default_factory=dict)
    training: dict[str, object] = field(default_factory=dict)
    everywhere: bool = False
    slope_limit: int | None = None
    level_light: bool = False
    smoothing_px: int = 0


CAUSES = (
    Cause(AS_RECORDED),
    Cause("no saturation", {"brightest_dn": 180.0}),
    Cause("no cast shadows", {"cast_shadows": False}),
    Cause("the same light in every press", {"light_noise": 0.0}),
    Cause("light levelled", level_light=True),
    Cause("light levelled, circle_margin 0.1", training={"circle_margin": 0.1}, level_light=True),
    Cause("light levelled, flat_fraction 0.05", training={"flat_fraction": 0.05}, level_light=True),
    Cause(
        "light levelled, circle_margin 0.1, flat_fraction 0.05",
        training=LIKE_GELSIGHT,
        level_light=True,
    ),
    Cause(
        "light levelled, circle_margin 0.1, flat_fraction 0.05, depth_weight 0.005",
        training={**LIKE_GELSIGHT, "depth_weight": 0.005, "depth_epochs": 30},
        level_light=True,
    ),
    *(
        Cause(
            f"light levelled, circle_margin 0.1, flat_fraction 0.05, smoothed over {px} px",
            training=LIKE_GELSIGHT,
            level_light=True,
            smoothing_px=px,
        )
        for px in WINDOWS_PX
    ),
    Cause("exact circles", {"circle_noise_mm": 0.0}),
    Cause("circles a pixel too large", {"circle_bias_mm": PIXEL_MM}),
    Cause("circles a pixel too small", {"circle_bias_mm": -PIXEL_MM}),
    Cause("light presses train too", {"presses": "graded"}),
    Cause("no noise in training", training={"input_noise": 0.0, "position_noise": 0.0}),
    Cause("flat_fraction 0.05", training={"flat_fraction": 0.05}),
    Cause("flat_fraction 0.4", training={"flat_fraction": 0.4}),
    Cause("the whole skin labelled", training={"normals_epochs": WHOLE_EPOCHS}, everywhere=True),
    Cause("slope_limit 1", slope_limit=1),
    Cause("slope_limit 2", slope_limit=2),
    Cause("circle_margin 0.1", training={"circle_margin": 0.1}),
    Cause("flat_beyond 3", training={"flat_beyond": 3.0}),
    Cause(MENDED, training={"circle_margin": 0.1, "flat_beyond": 3.0}),
    Cause(
        "these, flat_fraction 0.05",
        training={"circle_margin": 0.1, "flat_beyond": 3.0, "flat_fraction": 0.05},
    ),
    Cause(
        "these, light presses train too",
        {"presses": "graded"},
        {"circle_margin": 0.1, "flat_beyond": 3.0},
    ),
)
"""What is suspected, and what mends it. Saturation and shadows are switched off in the test, too."""


def named(names: Sequence[str]) -> list[Cause]:
    """The training as recorded and those of the names; raises ValueError for a name that is none."""
    known = {cause.name: cause for cause in CAUSES}
    for name in names:
        if name not in known:
            raise ValueError(f"--cause {name!r}: expected one of {', '.join(map(repr, known))}")
    return [known[name] for name in dict.fromkeys((AS_RECORDED, *names))]
