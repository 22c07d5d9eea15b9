"""Reads pickles of arrays and plain values without unpickling them: nothing that a file names is ever called.

`load` steps through a pickle's opcodes itself and knows those alone that None, numbers, texts, bytes, lists,
tuples, dicts and NumPy's arrays need. Of the names in a file it knows those by which NumPy pickles arrays and
scalars, and does what they would do (pickled_arrays.py) on bytes whose number it has checked. Every other
name is refused, as are persistent ids, classes, sets, extensions and arrays of objects, but for an array of
one dict: that is what np.save makes of a dict.

Arrays are read-only and of booleans, integers or floats. Scalars of NumPy become Python's.
"""

import io
import pickletools
from collections.abc import Callable
from pathlib import Path

import numpy as np

from fastac.sensor.importers.footage import ImportFailure
from fastac.sensor.importers.pickled_arrays import NAMES, Dtype, Name, RefusedError, Unbuilt, array, call
from fastac.store.files import read_npy

VALUES = {
    *("NONE", "NEWTRUE", "NEWFALSE", "INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4"),
    *("FLOAT", "BINFLOAT", "STRING", "BINSTRING", "SHORT_BINSTRING", "UNICODE", "SHORT_BINUNICODE"),
    *("BINUNICODE", "BINUNICODE8", "SHORT_BINBYTES", "BINBYTES", "BINBYTES8", "BYTEARRAY8"),
}
"""Opcodes that put their argument on the stack."""
CONSTANTS = {"NONE": None, "NEWTRUE": True, "NEWFALSE": False}
MAKERS: dict[str, Callable[[], object]] = {"EMPTY_LIST": list, "EMPTY_TUPLE": tuple, "EMPTY_DICT": dict}
TUPLES = {"TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}


class _Machine:
    """A pickle's stack and memo; `step` does what one opcode says."""

    def __init__(self) -> None:
        self.stack: list = []
        self.marks: list[int] = []
        self.memo: dict[int, object] = {}

    def pop(self) -> object:
        if len(self.stack) <= (self.marks[-1] if self.marks else 0):
            raise RefusedError("a value that is not there")
        return self.stack.pop()

    def since_mark(self) -> list:
        if not self.marks:
            raise RefusedError("a mark that is not there")
        at = self.marks.pop()
        values, self.stack[at:] = self.stack[at:], []
        return values

    def top(self, kind: type) -> object:
        if not self.stack or type(self.stack[-1]) is not kind:
            raise RefusedError(f"a {kind.__name__} that is not there")
        return self.stack[-1]

    def extend(self, values: list) -> None:
        for value in values:
            if isinstance(value, Unbuilt | Name | Dtype):
                raise RefusedError("an array without values, or a name, as a value")
        self.top(list).extend(values)

    def set_items(self, values: list) -> None:
        keys, items = values[::2], values[1::2]
        if len(keys) != len(items):
            raise RefusedError("a key without a value")
        target = self.top(dict)
        for key, value in zip(keys, items, strict=True):
            if key is not None and type(key) not in (str, bytes, int, float, bool):
                raise RefusedError("a key that is no text and no number")
            if isinstance(value, Unbuilt | Name | Dtype):
                raise RefusedError("an array without values, or a name, as a value")
            target[key] = value

    def name(self, name: str) -> None:
        if name not in NAMES:
            raise RefusedError(f"the name {'.'.join(name.split(' ', 1))[:120]!a}, which is not read")
        self.stack.append(Name(NAMES[name]))

    def build(self) -> None:
        state = self.pop()
        if not self.stack or not isinstance(state, tuple):
            raise RefusedError("a state without an object")
        match self.stack[-1]:
            case Dtype() as dtype if len(state) >= 2 and state[1] in ("<", ">", "|", "="):
                dtype.order = state[1]
            case Unbuilt() as unbuilt if len(state) in (4, 5):
                shape, dtype, fortran, data = state[-4:]
                self.stack[-1] = value = array(data, dtype, shape, fortran)
                for key in unbuilt.memo:
                    self.memo[key] = value
            case _:
                raise RefusedError("a state of what is no array")

    def remember(self, key: int) -> None:
        if not self.stack:
            raise RefusedError("a value that is not there")
        if isinstance(self.stack[-1], Unbuilt):
            self.stack[-1].memo.append(key)
        self.memo[key] = self.stack[-1]

    def recall(self, key: int) -> None:
        if key not in self.memo or isinstance(self.memo[key], Unbuilt):
            raise RefusedError("a value that is not there yet")
        self.stack.append(self.memo[key])

    def step(self, opcode: str, argument: object) -> None:
        """Raises RefusedError for opcodes that are not read, and for what does not fit on the stack."""
        if opcode in VALUES:
            value = CONSTANTS.get(opcode, argument)
            self.stack.append(bytes(value) if isinstance(value, bytearray) else value)
        elif opcode in MAKERS:
            self.stack.append(MAKERS[opcode]())
        elif opcode in TUPLES:
            self.stack.append(tuple(self.pop() for _ in range(TUPLES[opcode]))[::-1])
        elif opcode in ("PUT", "BINPUT", "LONG_BINPUT", "MEMOIZE"):
            self.remember(len(self.memo) if opcode == "MEMOIZE" else argument)
        elif opcode in ("GET", "BINGET", "LONG_BINGET"):
            self.recall(argument)
        else:
            self._structure(opcode, argument)

    def _structure(self, opcode: str, argument: object) -> None:
        match opcode:
            case "PROTO" | "FRAME":
                pass
            case "MARK":
                self.marks.append(len(self.stack))
            case "TUPLE":
                self.stack.append(tuple(self.since_mark()))
            case "LIST" | "DICT":
                values = self.since_mark()
                self.stack.append([] if opcode == "LIST" else {})
                self.extend(values) if opcode == "LIST" else self.set_items(values)
            case "APPEND":
                self.extend([self.pop()])
            case "APPENDS":
                self.extend(self.since_mark())
            case "SETITEM":
                self.set_items([self.pop(), self.pop()][::-1])
            case "SETITEMS":
                self.set_items(self.since_mark())
            case "GLOBAL":
                self.name(argument)
            case "STACK_GLOBAL":
                name, module = self.pop(), self.pop()
                self.name(f"{module} {name}")
            case "REDUCE":
                given = self.pop()
                self.stack.append(call(self.pop(), given))
            case "BUILD":
                self.build()
            case _:
                raise RefusedError(f"the opcode {opcode}, which is not read")


class _Held:
    """A file from which no more is asked than it has left, whatever length a pickle declares."""

    def __init__(self, file: io.BufferedIOBase, left: int) -> None:
        self._file, self._left = file, left
        self.readline = file.readline

    def tell(self) -> int:
        return self._file.tell()

    def read(self, count: int) -> bytes:
        return self._file.read(min(count, self._left))


def _run(file: io.BufferedIOBase, size: int) -> object:
    machine = _Machine()
    for opcode, argument, _ in pickletools.genops(_Held(file, size)):
        if opcode.name == "STOP":
            if len(machine.stack) != 1 or machine.marks:
                raise RefusedError("an end with values left over")
            if isinstance(machine.stack[0], Unbuilt | Name | Dtype):
                raise RefusedError("an array without values, or a name, as a value")
            return machine.stack[0]
        machine.step(opcode.name, argument)
    raise RefusedError("no end")


def _read(path: Path, what: str, read: Callable[[io.BufferedIOBase, int], object]) -> object:
    """Open a file and read it; every failure becomes an ImportFailure of one line with its path."""
    try:
        with path.open("rb") as file:
            return read(file, path.stat().st_size)
    except FileNotFoundError:
        raise ImportFailure(f"{path}: no such file") from None
    except RefusedError as error:
        raise ImportFailure(f"{path}: refused: it holds {error}") from None
    except Exception as error:  # a damaged file meets whatever pickletools and NumPy raise
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise ImportFailure(f"{path}: damaged or no {what}: {reason[:200]}") from None


def load(path: Path) -> object:
    """The arrays and plain values in a pickle. Raises ImportFailure with the file and what is refused."""
    return _read(path, "pickle", _run)


def load_npy(path: Path) -> object:
    """The array in an .npy, or the dict that np.save wrote there. Raises ImportFailure for anything else."""

    def read(file, size: int) -> object:
        version = np.lib.format.read_magic(file)
        header = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
        _, _, dtype = header[version](file)
        if dtype.hasobject:
            return _run(file, size)
        file.seek(0)
        return read_npy(file, size)

    return _read(path, ".npy file", read)
