"""NumPy's arrays and scalars as pickles describe them, made of checked bytes without a call of what is named.

Of the names in a pickle these are known by which NumPy pickles arrays and scalars, and Python bytes.
"""

import math
from dataclasses import dataclass, field

import numpy as np

NUMERIC = ("numpy.core", "numpy._core")
NAMES = {
    "_codecs encode": "encode",
    "numpy ndarray": "ndarray",
    "numpy dtype": "dtype",
    "__builtin__ bytes": "bytes",
    **{f"{place}.multiarray {name}": name for place in NUMERIC for name in ("_reconstruct", "scalar")},
    **{f"{place}.numeric _frombuffer": "_frombuffer" for place in NUMERIC},
}
"""The names that a file may have, as opcodes give them, and what they stand for."""
MOST_AXES = 8
KINDS, OBJECTS = "biuf", "O"


class RefusedError(ValueError):
    """What a pickle asks for that is not done; the message says what."""


@dataclass(frozen=True)
class Name:
    """A name in the file; it is looked up nowhere."""

    name: str


@dataclass
class Dtype:
    """A dtype that is being built: its code such as f8, and the order of its bytes."""

    code: str
    order: str = "="

    def made(self) -> np.dtype:
        try:
            dtype = np.dtype(self.code).newbyteorder(self.order)
        except (TypeError, ValueError):
            raise RefusedError(f"dtype {self.code[:40]!r}") from None
        if dtype.kind not in KINDS + OBJECTS or dtype.itemsize > 8:
            raise RefusedError(f"an array of {self.code[:40]!r}: only numbers are read")
        return dtype


@dataclass
class Unbuilt:
    """An array whose values the file has not given yet, and where the memo has it."""

    memo: list[int] = field(default_factory=list)


def array(data: object, dtype: object, shape: object, fortran: object) -> object:
    """The array of these bytes, or of one object that object. Raises RefusedError where they do not fit."""
    if not isinstance(dtype, Dtype):
        raise RefusedError("an array without a dtype")
    if not isinstance(shape, tuple) or len(shape) > MOST_AXES:
        raise RefusedError("an array whose shape is none")
    if any(type(size) is not int or size < 0 for size in shape):
        raise RefusedError("an array whose shape is none")
    made = dtype.made()
    if made.kind == OBJECTS:
        if shape != () or not isinstance(data, list) or len(data) != 1:
            raise RefusedError(f"an array of objects of shape {shape}")
        return data[0]
    if isinstance(data, str):  # of Python 2
        data = data.encode("latin-1")
    if not isinstance(data, bytes):
        raise RefusedError("an array without bytes")
    declared = math.prod(shape) * made.itemsize
    if declared != len(data):
        raise RefusedError(f"an array of shape {shape}, {declared} bytes, of which {len(data)} are there")
    made_array = np.ndarray(shape, made, data, order="F" if fortran else "C")
    return made_array if made.isnative else made_array.astype(made.newbyteorder("="))


def call(function: object, given: object) -> object:
    """What one of NAMES makes of its arguments."""
    if not isinstance(function, Name) or not isinstance(given, tuple):
        raise RefusedError("a call of what is no function")
    match function.name, given:
        case "_reconstruct", (Name("ndarray"), _, _):
            return Unbuilt()
        case "dtype", (str() as code, _, _):
            return Dtype(code)
        case "scalar", (Dtype() as dtype, data):
            if dtype.made().kind == OBJECTS:
                raise RefusedError("a scalar that is an object")
            return array(data, dtype, (), False).item()
        case "_frombuffer", (data, dtype, shape, str() as order):
            return array(data, dtype, shape, order == "F")
        case "encode", (str() as text, "latin1"):
            return text.encode("latin-1")
        case "bytes", ():
            return b""
    raise RefusedError(f"a call of {function.name} with other arguments than NumPy's")
