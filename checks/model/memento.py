"""Capture the state of a graph of objects, and restore it."""

from collections import OrderedDict, deque
from collections.abc import Callable
from functools import partial
from typing import Any, Final, NamedTuple, TypeAlias

Contents: TypeAlias = list[tuple[Callable[[Any], None], Any]]
"""The content of each object at the time of capture, after the function that restores it."""

PACKAGES: Final = ("robot.", "protocol.bus.mailbox.", "checks.")
"""Modules whose classes hold state; instances of all other classes count as values."""

PERCEPTION: Final = "robot.core."
CONTROL: Final = ("robot.core.modes.", "robot.core.state.")
MAPPINGS: Final = (dict, OrderedDict)
SEQUENCES: Final = (list, deque)


class Memento(NamedTuple):
    """Captured state; `perception` changes only in a control period, `control` also otherwise."""

    control: Contents
    perception: Contents


class Shape(NamedTuple):
    """The way to capture instances of a class: by `slots`, or by fields if there are none."""

    slots: tuple[str, ...]
    perceives: bool


_shapes: dict[type, Shape | None] = {}
_values: set[type] = {bool, bytes, float, int, str, type(None)}
"""Classes whose instances hold no state, as far as they have been met."""


def capture(root: object) -> Memento:
    """Return the contents of `root` and of every object reachable from it."""
    memento = Memento([], [])
    seen: set[int] = set()
    values = _values
    pending: list[tuple[Any, bool]] = [(root, False)]
    while pending:
        one, perceives = pending.pop()
        kind = type(one)
        shape = None
        if isinstance(one, tuple):
            pending.extend([(inner, perceives) for inner in one if type(inner) not in values])
            continue
        if kind not in SEQUENCES and kind not in MAPPINGS and kind is not set:
            shape = shape_of(kind)
            if shape is None:
                values.add(kind)
                continue
            perceives = perceives or shape.perceives
        if id(one) in seen:
            continue
        seen.add(id(one))
        put, contents, inside = contents_of(one, shape)
        memento[perceives].append((put, contents))
        pending.extend([(inner, perceives) for inner in inside if type(inner) not in values])
    return memento


def contents_of(one: Any, shape: Shape | None) -> tuple[Callable[[Any], None], Any, Any]:
    """Return the function that restores an object, its content, and the objects in it."""
    if shape is None:
        contents = one.copy()
        if type(one) is list:
            return partial(one.__setitem__, slice(None)), contents, contents
        inside = contents.values() if type(one) in MAPPINGS else contents
        return partial(refill, one), contents, inside
    if shape.slots:
        values = [getattr(one, name) for name in shape.slots]
        return partial(set_slots, one, shape.slots), values, values
    fields = dict(vars(one))
    return vars(one).update, fields, fields.values()


def restore(memento: Memento, *, perception: bool) -> None:
    """Restore captured contents; objects created since then become unreachable."""
    put_back(memento.control)
    if perception:
        put_back(memento.perception)


def put_back(contents: Contents) -> None:
    """Restore the contents of some objects."""
    for put, was in contents:
        put(was)


def refill(one: Any, was: Any) -> None:
    """Restore a mapping, a set or a queue."""
    if one:
        one.clear()
    if was:
        (one.extend if type(one) is deque else one.update)(was)


def set_slots(one: Any, slots: tuple[str, ...], was: list[Any]) -> None:
    """Restore the slots of an object."""
    for name, value in zip(slots, was, strict=True):
        setattr(one, name, value)


def shape_of(kind: type) -> Shape | None:
    """Return how a class is captured; None if its instances are values."""
    if kind not in _shapes:
        _shapes[kind] = new_shape_of(kind)
    return _shapes[kind]


def new_shape_of(kind: type) -> Shape | None:
    """Determine how a class is captured."""
    module = f"{kind.__module__}."
    if not module.startswith(PACKAGES) or issubclass(kind, int | float | str | type):
        return None
    slots = tuple(getattr(kind, "__slots__", ()))
    perceives = module.startswith(PERCEPTION) and not module.startswith(CONTROL)
    has_fields = bool(slots) or bool(getattr(kind, "__dictoffset__", 0))
    return Shape(slots, perceives) if has_fields else None
