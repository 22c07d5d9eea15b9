"""Values of Python as words of Tcl."""

from collections.abc import Mapping, Sequence


def word(value: object) -> str:
    """One word: mappings and sequences become lists, None the empty word; ValueError for braces."""
    if isinstance(value, Mapping):
        value = " ".join(f"{word(key)} {word(item)}" for key, item in value.items())
        return f"{{{value}}}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return f"{{{' '.join(word(item) for item in value)}}}"
    text = "" if value is None else str(value)
    if any(letter in text for letter in "{}\\"):
        raise ValueError(f"{text!r}: expected no braces and no backslash")
    plain = text and all(letter.isalnum() or letter in "_./:+-*" for letter in text)
    return text if plain else f"{{{text}}}"


def array(name: str, content: Mapping[str, object]) -> str:
    """A command that sets the elements of an array."""
    lines = "".join(f"    {word(key)} {word(value)}\n" for key, value in content.items())
    return f"array set {name} {{\n{lines}}}\n"


def variable(name: str, value: object) -> str:
    """A command that sets a variable; of lists and dicts each item stands on a line of its own."""
    if isinstance(value, Mapping):
        lines = "".join(f"    {word(key)} {word(item)}\n" for key, item in value.items())
    elif isinstance(value, Sequence) and not isinstance(value, str):
        lines = "".join(f"    {word(item)}\n" for item in value)
    else:
        return f"set {name} {word(value)}\n"
    return f"set {name} {{\n{lines}}}\n"
