"""Whether the spread of the touching dots tells how near slip is: drags on the virtual fingertip.

In every step of a drag (fastac/studies/slip/drags.py) the contact mechanics know what share of the nodes in
contact sticks. It is compared with the spread that the bundle's integers find in the camera's frame, with
the same from the dots' true shifts and the skin's true displacement, and with F_t/F_z of the forces found,
which tells of slip only to one who knows μ. Everything is simulated.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from fastac.flow import frames
from fastac.models.integer.bundle import Bundle
from fastac.models.integer.dot_spread import LEAST_DOTS
from fastac.report.tables import Table
from fastac.scenes.schema import Scene
from fastac.sensor.fingertip import require_friction
from fastac.sensor.mechanics.indenter import Indenter
from fastac.sensor.mechanics.press import ContactError
from fastac.sensor.mechanics.rig import rig_of
from fastac.sensor.protocol import FingertipError
from fastac.store.files import write_json
from fastac.studies.slip import scores
from fastac.studies.slip.drags import OBJECTS, SHARES, drags
from fastac.studies.slip.measurement import DragRecord, record

LEVELS = (0.8, 0.5, 0.2)
"""Shares of sticking nodes at which the mean spread is stated."""
MEASURES = {
    "integers": "spread by the integers, px",
    "true_shifts": "spread of the true shifts, px",
    "force_ratio": "F_t/F_z found",
}
"""What is compared, and its name in tables."""


def require_slip(scene: Scene) -> None:
    """Raise FingertipError unless the scene is simulated with friction and has the output slip."""
    require_friction(scene, "study slip")
    if not scene.wants_slip:
        raise FingertipError(f"study slip: outputs = {', '.join(scene.outputs)}: expected slip among them")


def summary(records: Sequence[DragRecord]) -> dict:
    """Counts of states, areas under the curve, rank correlations and mean spreads of some drags.

    States with fewer than LEAST_DOTS dots in contact, found or true, are counted and otherwise left out.
    """
    slips = np.concatenate([one.slips[one.known] for one in records])
    content = {
        "states": sum(len(one.sticking) for one in records),
        "too_few_dots": sum(int((one.slip_dots < LEAST_DOTS).sum()) for one in records),
        "too_few_true_dots": sum(int((one.true_slip_dots < LEAST_DOTS).sum()) for one in records),
        "compared": len(slips),
        "compared_slipping": int(slips.sum()),
    }
    for name in MEASURES:
        pairs = [(one.measures[name][one.known], 1 - one.sticking[one.known]) for one in records]
        values = np.concatenate([pair[0] for pair in pairs])
        content[name] = {
            "area_under_curve": scores.area_under_curve(values, slips),
            "rank_correlation": scores.rank_correlation(pairs),
            "mean_at_sticking": {str(level): scores.mean_at(1 - level, pairs) for level in LEVELS},
            "best_limit": scores.best_limit(values, slips),
        }
    return content


def limit_rates(records: Sequence[DragRecord], limit: float, flagged: Sequence[np.ndarray]) -> dict:
    """Hits and false alarms of a limit: of the states compared, and of all.

    flagged : of each drag, (n,) bool, the states beyond the limit. Where too few dots are in contact the
        integers' spread is 0, so that the state is not flagged.
    """
    slips = np.concatenate([one.slips for one in records])
    known = np.concatenate([one.known for one in records])
    beyond = np.concatenate(flagged)
    return {
        "limit": limit,
        **scores.rates(beyond[known], slips[known]),
        "of_all_states": scores.rates(beyond, slips),
    }


def _as_json(one: DragRecord) -> dict:
    drag = one.drag
    return {
        "object": drag.name,
        "x_mm": drag.x_mm,
        "y_mm": drag.y_mm,
        "load_n": drag.load_n,
        "friction": drag.friction,
        "sticking": one.sticking.tolist(),
        "slip_px": one.slip_px.tolist(),
        "slip_dots": one.slip_dots.tolist(),
        "slipping": one.slipping.tolist(),
        "true_slip_px": one.true_slip_px.tolist(),
        "true_slip_dots": one.true_slip_dots.tolist(),
        "found_n": one.found_force_n.tolist(),
        "true_n": one.true_force_n.tolist(),
        "suspect_frames": int(one.suspect.sum()),
    }


def run(
    bundle: Bundle,
    folder: Path,
    *,
    objects: Mapping[str, Indenter] = OBJECTS,
    store: Path = frames.STORE,
    progress: bool = True,
) -> dict:
    """Simulate and measure all drags; write slip.json and slip.png into `folder`; return the JSON's content.

    Raises FingertipError for a scene without friction, three axes of force or the output slip, and where the
    contact can carry none of the drags.
    """
    from fastac.studies.slip import figures

    scene = bundle.scene
    require_slip(scene)
    rig = rig_of(scene.sensor, store, progress=progress)
    found = list(record(bundle, rig, drags(scene, objects), progress=progress))
    left_out = [str(one) for one in found if isinstance(one, ContactError)]
    records = [one for one in found if isinstance(one, DragRecord)]
    if not records:
        raise FingertipError(f"study slip: no drag is carried; {left_out[0]}")
    by_object = {}
    for one in records:
        by_object.setdefault(one.drag.name, []).append(one)
    everything = summary(records)
    limits = {"scene": limit_rates(records, scene.slip.limit_px, [one.slipping for one in records])}
    for name in MEASURES:
        best = everything[name]["best_limit"]
        if best is not None:
            limits[name] = limit_rates(records, best, [one.measures[name] > best for one in records])
    content = {
        "source": "simulated",
        "scene": scene.name,
        "bundle": bundle.digest,
        "contact_mm": scene.slip.contact_mm,
        "limit_px": scene.slip.limit_px,
        "pulls": list(SHARES),
        "left_out": left_out,
        "by_object": {name: summary(some) for name, some in by_object.items()},
        "all": everything,
        "limits": limits,
        "drags": [_as_json(one) for one in records],
    }
    folder.mkdir(parents=True, exist_ok=True)
    figures.spreads(by_object, content, folder / "slip.png")
    write_json(folder / "slip.json", content)
    return content


def _number(value: float | None, digits: int = 2) -> str:
    return "" if value is None else f"{value:.{digits}f}"


def tables(content: dict) -> list[Table]:
    """What tells slip how well, the spreads, and what limits are worth, from the content of slip.json."""
    quality, spread = [], []
    for name, one in (content["by_object"] | {"all": content["all"]}).items():
        counts = ("states", "too_few_dots", "compared", "compared_slipping")
        areas = (_number(one[measure]["area_under_curve"], 3) for measure in MEASURES)
        ranks = (_number(one[measure]["rank_correlation"]) for measure in ("integers", "true_shifts"))
        quality.append([name, *(f"{one[key]:,}" for key in counts), *areas, *ranks])
        levels = [
            _number(one[measure]["mean_at_sticking"][str(level)])
            for measure in ("integers", "true_shifts")
            for level in LEVELS
        ]
        best = (_number(one[measure]["best_limit"]) for measure in ("integers", "true_shifts"))
        spread.append([name, *levels, *best])
    titles = {"scene": "slip.limit_px of the scene"}
    titles |= {name: f"best limit of {title}" for name, title in MEASURES.items()}
    limits = [
        [
            titles[name],
            _number(one["limit"], 3),
            *(_number(rates[key]) for rates in (one, one["of_all_states"]) for key in ("hit", "false_alarm")),
        ]
        for name, one in content["limits"].items()
    ]
    at = [f"{level:.0%}" for level in LEVELS]
    return [
        Table(
            "Do fewer than half of the nodes in contact stick?",
            [
                *("object", "states", f"< {LEAST_DOTS} dots", "compared", "of which slip"),
                *("area: integers", "true shifts", "F_t/F_z", "rank: integers", "true shifts"),
            ],
            quality,
            "area: under the ROC curve; rank: correlation with the share of sliding nodes, mean over drags;"
            f" {len(content['left_out'])} drags left out, as their contact cannot carry them; simulated",
        ),
        Table(
            "Mean spread in px where so many nodes stick, and the limit in px that tells best",
            [
                "object",
                f"integers: {at[0]}",
                *at[1:],
                f"true shifts: {at[0]}",
                *at[1:],
                "limit",
                "true shifts",
            ],
            spread,
        ),
        Table(
            "Limits",
            ["flagged beyond", "limit", "hits", "false alarms", "all states: hits", "false alarms"],
            limits,
            "hits: share of the slipping states that are flagged; with fewer than"
            f" {LEAST_DOTS} dots in contact there is no spread and no flag",
        ),
    ]
