"""The keys of a scene in Markdown, table by table, from its schema: values, defaults, units, meanings."""

import ast
import inspect
import re
import textwrap
from collections.abc import Iterator
from itertools import pairwise

from pydantic import BaseModel

from fastac.scenes.force_fits import FITS
from fastac.scenes.outputs import OUTPUTS
from fastac.scenes.parts import PARTS
from fastac.scenes.schema import Scene
from fastac.scenes.solvers import SOLVERS

CHOICES = {"outputs": OUTPUTS, "poisson.solver": SOLVERS, "force.fit": FITS, "hardware.part": PARTS}
"""Keys whose values are entries of a table, which the schema alone does not tell."""
UNITS = {
    "_mm": "mm",
    "_n": "N",
    "_px": "px",
    "_dn": "digital numbers",
    "_mpa": "MPa",
    "_mhz": "MHz",
    "_bits": "bits",
}
"""Unit of a key by the end of its name."""


def key_id(key: str) -> str:
    """The anchor of a key such as "sensor.light.ambient" in the page of keys."""
    return f"key-{key.replace('.', '-')}"


def known_keys() -> set[str]:
    """Every key and table of a scene."""
    return {key for table, path in _tables(Scene, "") for key in _own_keys(table, path)}


def scene_keys() -> str:
    """A section for each table of a scene, with a row for each key."""
    definitions = Scene.model_json_schema()["$defs"]
    parts = []
    for table, path in _tables(Scene, ""):
        schema = definitions[table.__name__] if path else Scene.model_json_schema()
        parts += [f"({key_id(path)})=", f"## `[{path}]`"] if path else ["## The scene itself"]
        if text := _class_text(table):
            parts.append(text)
        rows = [
            f'| <span id="{key_id(whole)}"></span>`{whole.split(".")[-1]}` | {" | ".join(cells)} |'
            for whole, *cells in _rows(table, path, schema)
        ]
        parts.append("\n".join(["| key | default | values | meaning |", "|---|---|---|---|", *rows]))
    return "\n\n".join(parts)


def _own_keys(table: type[BaseModel], path: str) -> Iterator[str]:
    for key in table.model_fields:
        yield f"{path}.{key}" if path else key


def _tables(table: type[BaseModel], path: str) -> Iterator[tuple[type[BaseModel], str]]:
    """The table and those inside it, each with its path, in the order of the schema."""
    yield table, path
    for key, field in table.model_fields.items():
        inside = _table_of(field.annotation)
        if inside is not None:
            yield from _tables(inside, f"{path}.{key}" if path else key)


def _table_of(annotation) -> type[BaseModel] | None:
    kinds = (annotation, *getattr(annotation, "__args__", ()))
    return next((kind for kind in kinds if inspect.isclass(kind) and issubclass(kind, BaseModel)), None)


def _rows(table: type[BaseModel], path: str, schema: dict) -> Iterator[tuple[str, str, str, str]]:
    texts, required = _field_texts(table), schema.get("required", ())
    for key, facts in schema["properties"].items():
        whole = f"{path}.{key}" if path else key
        inside = _table_of(table.model_fields[key].annotation)
        if inside is not None:
            default = "–" if table.model_fields[key].default is not None else "no table"
            if key in required:
                default = "needed"
            values = f"table [`[{whole}]`](#{key_id(whole)})"
        else:
            default = "needed" if key in required else _default(facts.get("default"))
            values = _choices(CHOICES[whole]) if whole in CHOICES else _values(facts)
            values += f", {unit}" if (unit := unit_of(key)) else ""
        yield whole, default, values, texts.get(key, "")


def unit_of(key: str) -> str:
    """The unit that a key's name ends in, "" where it has none; ratios such as electrons_per_dn have none."""
    return "" if "_per_" in key else next((unit for end, unit in UNITS.items() if key.endswith(end)), "")


def _default(value) -> str:
    if value is None:
        return "not given"
    return f"`{_toml(value)}`"


def _toml(value) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return f"[{', '.join(_toml(part) for part in value)}]"
    if isinstance(value, str):
        return f'"{value}"'
    return f"{value:g}" if isinstance(value, float) else str(value)


def _choices(names) -> str:
    return ", ".join(f"`{_toml(name)}`" for name in names)


def _values(facts: dict) -> str:
    """What values the schema takes, in words."""
    if "anyOf" in facts:
        return "; or ".join(_values(kind) for kind in facts["anyOf"] if kind.get("type") != "null")
    if "enum" in facts:
        return _choices(facts["enum"])
    if facts["type"] == "array":
        return _array(facts)
    kind = {"integer": "integer", "number": "number", "boolean": "`true`, `false`", "string": "text"}
    text = kind[facts["type"]]
    if "pattern" in facts:
        text += f" that matches `{facts['pattern']}`"
    low, high = facts.get("minimum"), facts.get("maximum")
    if low is not None and high is not None:
        return f"{text}, {low:g} to {high:g}"
    signs = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    limits = [f"{sign} {facts[name]:g}" for name, sign in signs.items() if name in facts]
    return f"{text} {', '.join(limits)}" if limits else text


def _array(facts: dict) -> str:
    if "prefixItems" in facts:
        return f"{len(facts['prefixItems'])} of: {_values(facts['prefixItems'][0])}"
    return f"list of: {_values(facts['items'])}"


def _class_text(table: type[BaseModel]) -> str:
    """The table's own docstring, not the one of what it inherits."""
    own = table.__dict__.get("__doc__")
    return " ".join(inspect.cleandoc(own).split()) if own else ""


def _field_texts(table: type[BaseModel]) -> dict[str, str]:
    """{key: the text behind it in the source}, in one line of Markdown."""
    body = ast.parse(textwrap.dedent(inspect.getsource(table))).body[0].body
    found = {}
    for field, text in pairwise(body):
        is_text = isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
        if isinstance(field, ast.AnnAssign) and is_text:
            found[field.target.id] = _marked(" ".join(text.value.value.split()))
    return found


def _marked(text: str) -> str:
    """The text for a table's cell, with paths of files as code."""
    text = re.sub(r"(?<![`\w/])((?:\w+/)+\w+\.py)", r"`\1`", text)
    return text.replace("|", "\\|")
