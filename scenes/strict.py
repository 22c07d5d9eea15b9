"""What every table of a scene shares: unknown keys are errors, values cannot be changed."""

from collections.abc import Mapping
from typing import Annotated

from pydantic import ConfigDict, Field

from fastac.scenes.watched import Watchable

Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=1)]
Share = Annotated[float, Field(ge=0, le=2)]
Point = tuple[float, float]


class Strict(Watchable):
    """Base of every table of a scene; what a step of a build reads of it can be recorded."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def listed(names) -> str:
    """'a', 'b' or 'c'."""
    *others, last = (repr(name) for name in names)
    return f"{', '.join(others)} or {last}" if others else last


def require_known(key: str, name: str, table: Mapping[str, object]) -> None:
    """Raise ValueError, which tells the scene's key and what there is, unless the table has this name.

    To be called by the scene alone: what the tables' own defaults run would count as used by every step.
    """
    try:
        table[name]
    except KeyError:
        raise ValueError(f"{key} = {name!r}: Input should be {listed(table)}") from None
