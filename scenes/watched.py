"""Settings that tell which of their values are read.

`settings.watched(read)` is an equal instance of the same class that calls `read(path, value)` for each value
read from it, so that a result can be tied to the values it used instead of to all settings.
"""

import copy
import inspect
from collections.abc import Callable, Iterable, Iterator
from functools import cache, cached_property, partial
from types import FunctionType
from typing import Self

from pydantic import BaseModel

Read = Callable[[str, object], None]
"""Called with a dotted path and the plain value found there, or with a path and a class of settings: then
code of that class has run, or may run later, whose reads are not told."""

ALL_FIELDS = "*"
"""Last part of the path whose value is the names of all fields."""
_OWN = frozenset({"watched", "unwatched", "value_at", "means_the_same"})
_DUMPS = frozenset({"model_dump", "model_dump_json"})
_INSTANCE_STATE = frozenset({"__pydantic_extra__", "__pydantic_private__"})
_DESCRIPTION = frozenset({"__class__", "__doc__", "__module__", "__annotations__", "__class_vars__"})
_CONSTRUCTION = frozenset({"__new__", "__init__", "__init_subclass__", "__class_getitem__"})


class Watchable(BaseModel):
    """Base class of settings: frozen pydantic models, nested in each other as fields.

    Told are: a field or the value of a property that is read, and that a nested model is there or None.
    Inside a property nothing is told, for its value stands for all that it reads. Whatever takes the settings
    as a whole (dumping, copying, comparing, hashing, iterating, pickling, printing, calling a method) tells
    all fields below. Unless only data leaves (dumping, comparing, printing), it also tells the classes: a
    copy, or a result cached under a hash, can run their code unwatched later.
    """

    def watched(self, read: Read) -> Self:
        """An equal instance whose reads call `read`, from whichever thread they happen in."""
        return _watch(self, "", read)

    def unwatched(self) -> Self:
        """The settings behind all watching; themselves where nothing watches."""
        watch = _watch_of(self)
        return self if watch is None else watch.original.unwatched()

    def value_at(self, path: str) -> object:
        """What `read` would be told at this path; raises AttributeError where there is nothing."""
        value = self
        *parents, last = path.split(".")
        for name in parents:
            value = getattr(value, name)
        return _field_names(value) if last == ALL_FIELDS else _plain(getattr(value, last), [])

    def means_the_same(self, path: str, before: object) -> bool:
        """Whether a result that read `before` at this path holds, though the present value is another."""
        return path.split(".")[-1] == ALL_FIELDS and added_at_default(self, path, before)


def added_at_default(settings: Watchable, path: str, before: Iterable[str]) -> bool:
    """Whether the fields at an ALL_FIELDS path are those of `before` and others that have their defaults.

    Then settings that were written when there were only those of `before` still mean the same.
    """
    for name in path.split(".")[:-1]:
        settings = getattr(settings, name)
    fields, before = _schema(settings).model_fields, set(before)
    added = fields.keys() - before
    at_default = all(
        getattr(settings, name) == fields[name].get_default(call_default_factory=True) for name in added
    )
    return before <= fields.keys() and at_default


def _itself(settings: Watchable) -> Watchable:
    """What unpickling calls: what was watched arrives unwatched."""
    return settings


def _watch_of(settings: object) -> "_Watch | None":
    return vars(type(settings)).get("_watch")


def _schema(settings: Watchable) -> type[Watchable]:
    """The class as it was declared."""
    watch = _watch_of(settings)
    return type(settings) if watch is None else watch.schema


def _field_names(settings: object) -> tuple[str, ...]:
    if not isinstance(settings, Watchable):
        raise AttributeError(f"no settings: {settings!r}")
    return tuple(sorted(_schema(settings).model_fields))


class NotPlainError(TypeError):
    """A value that cannot be compared with one recorded earlier."""


def _plain(value: object, classes: list[type]) -> object:
    """The value as plain data; nested settings below containers as their fields, their classes listed."""
    if isinstance(value, Watchable):
        return {"model": _schema(value).__qualname__}
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, tuple | list | set | frozenset):
        items = [_nested(item, classes) for item in value]
        return tuple(items) if isinstance(value, tuple) else items if isinstance(value, list) else set(items)
    if isinstance(value, dict):
        return {_nested(key, classes): _nested(item, classes) for key, item in value.items()}
    raise NotPlainError(f"{value!r} is a {type(value).__name__}, which no record can hold")


def _nested(value: object, classes: list[type]) -> object:
    if not isinstance(value, Watchable):
        return _plain(value, classes)
    classes.append(_schema(value))
    fields = {name: _nested(getattr(value, name), classes) for name in _field_names(value)}
    return {"model": _schema(value).__qualname__, "fields": fields}


@cache
def _rules(schema: type[Watchable]) -> frozenset[str]:
    """Names of a class's properties, computed fields included."""

    def is_rule(member: object) -> bool:
        return isinstance(getattr(member, "wrapped", member), property | cached_property)

    members = ((name, inspect.getattr_static(schema, name, None)) for name in dir(schema))
    return frozenset(name for name, member in members if is_rule(member) and not name.startswith("__"))


@cache
def _dump_runs_code(schema: type[Watchable]) -> bool:
    decorators = schema.__pydantic_decorators__
    return any((decorators.computed_fields, decorators.field_serializers, decorators.model_serializers))


class _Watch:
    """What stands behind one watched instance."""

    def __init__(self, original: Watchable, path: str, read: Read):
        self.original = original
        self.schema = _schema(original)
        self.path = path
        self.read = read
        self.nested: dict[str, tuple[Watchable, Watchable]] = {}

    def at(self, name: str) -> str:
        return f"{self.path}.{name}" if self.path else name

    def get(self, name: str) -> object:
        if name in self.schema.model_fields or name in _rules(self.schema):
            return self.value(name)
        if name in _OWN:
            return partial(getattr(Watchable, name), self.instance)
        if name in _DUMPS:
            return partial(self.dump, name)
        if name == "__pydantic_fields_set__":
            return self.value("model_fields_set")
        about_class = name.startswith("__pydantic_") and name not in _INSTANCE_STATE
        if about_class or name in _DESCRIPTION:
            return object.__getattribute__(self.instance, name)
        self.whole(code=True)
        if name in ("__reduce__", "__reduce_ex__"):
            return lambda *_: (_itself, (self.original,))
        return getattr(self.original, name)

    def value(self, name: str) -> object:
        """A field or a property, told; nested settings are watched in turn."""
        try:
            value = getattr(self.original, name)
        except Exception:
            self.whole(code=True)
            raise
        if isinstance(value, Watchable):
            self.read(self.at(name), _plain(value, []))
            known = self.nested.get(name)
            if known is None or known[0] is not value:
                known = self.nested[name] = value, _watch(value, self.at(name), self.read)
            return known[1]
        classes: list[type] = []
        try:
            self.read(self.at(name), _plain(value, classes))
        except NotPlainError:
            if name in self.schema.model_fields:
                raise
            self.whole(code=True)
        for schema in classes:
            self.read(self.at(name), schema)
        return value

    def whole(self, *, code: bool) -> None:
        """Tell all fields below, and the classes too if code of theirs can run unwatched."""
        self.read(self.at(ALL_FIELDS), _field_names(self.original))
        if code:
            self.read(self.path, self.schema)
        for name in self.schema.model_fields:
            value = self.value(name)
            if isinstance(value, Watchable):
                _watch_of(value).whole(code=code)

    def dump(self, method: str, *arguments: object, **options: object) -> object:
        self.whole(code=self.dump_runs_code())
        if options.get("exclude_unset"):
            self.fields_set()
        return getattr(self.original, method)(*arguments, **options)

    def dump_runs_code(self) -> bool:
        below = (self.value(name) for name in self.schema.model_fields)
        nested = (_watch_of(value) for value in below if isinstance(value, Watchable))
        return _dump_runs_code(self.schema) or any(watch.dump_runs_code() for watch in nested)

    def fields_set(self) -> None:
        self.value("model_fields_set")
        for name in self.schema.model_fields:
            value = self.value(name)
            if isinstance(value, Watchable):
                _watch_of(value).fields_set()

    def equals(self, other: object) -> bool:
        self.whole(code=False)
        return self.original == other

    def items(self) -> Iterator[tuple[str, object]]:
        self.read(self.at(ALL_FIELDS), _field_names(self.original))
        return iter([(name, self.value(name)) for name in self.schema.model_fields])

    def data(self, function: Callable, *arguments: object) -> object:
        self.whole(code=False)
        return function(self.original, *arguments)

    def run(self, function: Callable, *arguments: object, **options: object) -> object:
        self.whole(code=True)
        return function(self.original, *arguments, **options)


class _ClassFields:
    """`model_fields` of a watched instance's class: looking through them reads which fields there are."""

    def __init__(self, watch: _Watch):
        self.watch = watch

    def __get__(self, instance: object, owner: type) -> object:
        self.watch.whole(code=True)
        return self.watch.schema.model_fields


def _watch(original: Watchable, path: str, read: Read) -> Watchable:
    """A watched instance, of a class of its own below the settings' class.

    Python looks special methods up on the class; that of an unwatched instance stays as fast as it was.
    """
    watch = _Watch(original, path, read)
    schema = watch.schema

    def through(function: Callable) -> Callable:
        return lambda _, *arguments, **options: function(*arguments, **options)

    def refuse(_: type, *arguments: object, **values: object) -> None:
        raise TypeError(f"construct {schema.__name__} by its name, not by the class of watched settings")

    namespace = {
        name: through(partial(watch.run, member))
        for base in reversed(schema.__mro__)
        if issubclass(base, Watchable) and base is not Watchable
        for name, member in vars(base).items()
        if name[:2] == name[-2:] == "__" and isinstance(member, FunctionType)
        if not name.startswith("__pydantic_") and name not in _CONSTRUCTION
    }
    namespace |= {
        "__slots__": (),
        "__module__": schema.__module__,
        "__qualname__": schema.__qualname__,
        "__new__": refuse,
        "__getattribute__": through(watch.get),
        "__setattr__": through(partial(setattr, original)),
        "__delattr__": through(partial(delattr, original)),
        "__eq__": through(watch.equals),
        "__hash__": through(partial(watch.run, hash)),
        "__iter__": through(watch.items),
        "__repr__": through(partial(watch.data, repr)),
        "__str__": through(partial(watch.data, str)),
        "__copy__": through(partial(watch.run, copy.copy)),
        "__deepcopy__": through(partial(watch.run, copy.deepcopy)),
        "__replace__": through(lambda **changes: watch.run(schema.model_copy, update=changes)),
        "model_fields": _ClassFields(watch),
        "_watch": watch,
    }
    # type.__new__ instead of the metaclass: pydantic has nothing to build for a class without own fields.
    watch.instance = object.__new__(type.__new__(type(schema), schema.__name__, (schema,), namespace))
    return watch.instance
