"""Size of the state that a navigator keeps from tick to tick, as on MicroPython's heap.

The scenarios run in this process, and the objects of the navigator are counted after every tick.
The result is the largest state found.

The model has blocks of 16 bytes and words of 4. An instance is a block and a map of 8 bytes per
attribute, whatever its `__slots__`. A list is 16 bytes and a word per item, a tuple 8 and a word
per item, a bytearray 16 and its bytes. A float is a block. An int up to 30 bits takes nothing, a
longer one two blocks. Numbers and strings of the program are in flash. Every float counts
separately, although two names may share one.
"""

from typing import Any, Final

from checks.speed.board.scenarios import TickScenario, run_scenario
from robot.hosting import InProcessCore

BOX_BYTES = 16
WORD_BYTES = 4
SMALL_INT = 1 << 30
MAP_ENTRY_BYTES = 8
INSTANCE_BYTES = 16


def heap_bytes(thing: Any, seen: set[int] | None = None) -> int:
    """Return the size of an object with all that it references."""
    seen = set() if seen is None else seen
    if thing is None or isinstance(thing, bool | str | type):
        return 0
    if isinstance(thing, float):
        return BOX_BYTES
    if isinstance(thing, int):
        return 2 * BOX_BYTES if is_long(thing) else 0
    if id(thing) in seen:
        return 0
    seen.add(id(thing))
    inside = sum(heap_bytes(part, seen) for part in parts(thing))
    return inside + own_bytes(thing)


def own_bytes(thing: Any) -> int:
    """Return the size of an object alone."""
    if isinstance(thing, bytearray | bytes):
        return BOX_BYTES + rounded(len(thing))
    if isinstance(thing, list):
        return BOX_BYTES + rounded(WORD_BYTES * len(thing))
    if isinstance(thing, tuple):
        return rounded(WORD_BYTES * (2 + len(thing)))
    return INSTANCE_BYTES + rounded(MAP_ENTRY_BYTES * len(slots(thing)))


def parts(thing: Any) -> list[Any]:
    """Return the objects that an object references."""
    if isinstance(thing, bytearray | bytes):
        return []
    if isinstance(thing, list | tuple):
        return list(thing)
    return [getattr(thing, name) for name in slots(thing)]


def slots(thing: Any) -> tuple[str, ...]:
    """Return the attributes of an object.

    Raises TypeError for types that the core may not use: without __slots__, dict, set.
    """
    names: tuple[str, ...] | None = getattr(type(thing), "__slots__", None)
    if names is None or hasattr(thing, "__dict__"):
        raise TypeError(f"{type(thing).__name__}: no __slots__, so its size is not bounded")
    return names


def lengths(thing: Any, seen: set[int] | None = None) -> int:
    """Return the number of items in all lists below an object, which grows if any list grows.

    A tuple is a value like a number.
    """
    seen = set() if seen is None else seen
    if thing is None or isinstance(thing, bool | str | type | int | float) or id(thing) in seen:
        return 0
    seen.add(id(thing))
    own = len(thing) if isinstance(thing, bytearray | list) else 0
    return own + sum(lengths(part, seen) for part in parts(thing))


def is_long(value: int) -> bool:
    """Return whether an int is on the heap."""
    return not -SMALL_INT <= value < SMALL_INT


def rounded(size_bytes: int) -> int:
    """Return a size in whole blocks of the heap."""
    return -(-size_bytes // BOX_BYTES) * BOX_BYTES


SCENARIOS: Final = 4
TICKS: Final = 80


def state_bytes(navigator: str, scenarios: int = SCENARIOS, ticks: int = TICKS) -> int:
    """Return the largest state of a navigator in bytes."""
    most = 0
    for number in range(scenarios):
        scenario = TickScenario(navigator, number)
        core = InProcessCore(scenario.params())
        estimate = {id(core.state.odometry)}  # the robot's, which a proof only reads
        for _ in run_scenario(core, scenario.body(), ticks):
            most = max(most, heap_bytes(core.state.memory, set(estimate)))
    return most
