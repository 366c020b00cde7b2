"""Write the modules generated from the dialect: `make generate`.

Messages, enumerations, reasons and wire layouts of the protocol, and the numbers of the control
core, are generated from sidestep.xml and the part of common.xml that common_subset names. The
output is deterministic; a test compares it with the committed modules.
"""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Final

from protocol.dialect.definitions import Dialect, Entry, EnumType, MessageType, read_dialect
from protocol.dialect.python_text import (
    class_name,
    constant_lines,
    enum_lines,
    import_lines,
    layout_lines,
    message_lines,
    module,
    table_lines,
)

ROOT: Final = Path(__file__).resolve().parents[2]
WIRE: Final = "protocol/wire"
"""Folder and package of the typed messages."""
CORE: Final = "robot/core"

OPERATOR_MESSAGES: Final = frozenset(
    {
        "GOAL_REQUEST",
        "COMMAND_REQUEST",
        "LEASE_REQUEST",
        "LEASE_STATUS",
        "GATEWAY_STATUS",
        "TELEOP",
        "MISSION_STATUS",
        "MISSION_VERDICT",
    }
)
"""Messages between operators and robots, besides the common ones."""
BOARD: Final = "BOARD_"
FIRST_OWN_ID: Final = 54_100
REASON: Final = "SIDESTEP_REASON"
ENUM_CLASSES: Final = {
    "SIDESTEP_VEHICLE": "Vehicle",
    "SIDESTEP_MODE": "Mode",
    "SIDESTEP_GOAL": "GoalState",
    "SIDESTEP_NAVIGATOR": "Navigator",
    "SIDESTEP_BRANCH": "Branch",
    "SIDESTEP_RUN_ACTION": "RunAction",
    "SIDESTEP_LEASE_ACTION": "LeaseAction",
    "SIDESTEP_MISSION": "MissionState",
    "SIDESTEP_RESET": "ResetCause",
    "SIDESTEP_STOP_EXTENT": "StopExtent",
    "MAV_MISSION_TYPE": "MissionType",
    "MAV_CMD": "Command",
    "MAV_RESULT": "AckResult",
    "MAV_SEVERITY": "Severity",
    "MAV_STATE": "SystemState",
}
COMMON_TEXTS: Final = {
    "MAV_MISSION_TYPE": "MAV_MISSION_TYPE: content of a transfer of items.",
    "MAV_CMD": "The MAV_CMD numbers in use.",
    "MAV_RESULT": "MAV_RESULT of a COMMAND_ACK.",
    "MAV_SEVERITY": "MAV_SEVERITY of a STATUSTEXT.",
    "MAV_STATE": "MAV_STATE of a HEARTBEAT.",
}
CONSTANTS: Final = {
    "SIDESTEP_BUMPER": "BUMPER",
    "SIDESTEP_INPUT": "INPUT",
    "SIDESTEP_BOARD": "BOARD",
    "MAV_TYPE": "TYPE",
    "MAV_AUTOPILOT": "AUTOPILOT",
    "MAV_MODE_FLAG": "MODE_FLAG",
    "MAV_FRAME": "FRAME",
    "MAV_PARAM_TYPE": "PARAM_TYPE",
}
"""Enumerations that become plain integers: bit masks, and those with few members in use."""
CORE_STATES: Final = (
    "SIDESTEP_VEHICLE",
    "SIDESTEP_MODE",
    "SIDESTEP_GOAL",
    "SIDESTEP_NAVIGATOR",
    "SIDESTEP_BRANCH",
    "SIDESTEP_BUMPER",
)
CORE_NAMES: Final = {
    ("SIDESTEP_REASON", "NONE"): "OK",
    ("SIDESTEP_BRANCH", "NONE"): "NO_BRANCH",
    ("SIDESTEP_BUMPER", "LEFT"): "BUMPER_LEFT",
    ("SIDESTEP_BUMPER", "RIGHT"): "BUMPER_RIGHT",
    ("SIDESTEP_BUMPER", "REAR"): "BUMPER_REAR",
}
"""Members with another name in the core, where no class name precedes them."""
MAX_NAMES: Final = {
    ("WHEEL_COMMAND", "ttl_ms"): "MAX_WHEEL_TTL_MS",
    ("TELEOP", "ttl_ms"): "MAX_TELEOP_TTL_MS",
    ("LEASE_STATUS", "lapses_ms"): "MAX_LEASE_MS",
    ("LEASE_REQUEST", "name"): "MAX_OPERATOR_NAME_BYTES",
    ("PARAM_SET", "param_id"): "MAX_PARAMETER_NAME_BYTES",
}
"""Names of the constants for maximum values of fields and for sizes of texts."""
SOURCE: Final = (
    "A timeout is that of its SIDESTEP_REASON, a time-to-live the maxValue of its field."
)
"""Origin of the limits, for the modules that contain them."""
SIDES: Final = (
    Entry("LEFT", 1, "Sides on which the robot passes an obstacle."),
    Entry("RIGHT", -1, ""),
)


def messages_common(dialect: Dialect) -> str:
    """Return the module of messages taken from common.xml."""
    return message_module("Messages taken over from MAVLink's common.xml.", common(dialect))


def messages_operator(dialect: Dialect) -> str:
    """Return the module of messages between operators and robots."""
    docstring = "Messages of operators and robots: requests, lease, teleop, mission."
    return message_module(docstring, operator(dialect))


def messages_robot(dialect: Dialect) -> str:
    """Return the module of messages of the control loop."""
    docstring = "Messages of the control loop and of a run: senses, wheels, status, score."
    return message_module(docstring, robot(dialect))


def messages_board(dialect: Dialect) -> str:
    """Return the module of messages between a host and the board that runs the core."""
    docstring = "Messages of the serial link between a host and the board that runs the core."
    return message_module(docstring, board(dialect))


def message_module(docstring: str, messages: list[MessageType]) -> str:
    """Return a module of message classes."""
    text = [line for message in messages for line in message_lines(message, NAMES_OF_ENUM)]
    checks = [name for name in ("too_long", "unfit") if any(f"{name}(" in line for line in text)]
    source = f"{package()}.message"
    return module(docstring, ["", *import_lines(source, ["Message", *checks])], text)


def common(dialect: Dialect) -> list[MessageType]:
    """Return the messages of common.xml."""
    return [message for message in dialect.messages if message.number < FIRST_OWN_ID]


def operator(dialect: Dialect) -> list[MessageType]:
    """Return our own messages between operators and robots."""
    return [message for message in dialect.messages if message.name in OPERATOR_MESSAGES]


def board(dialect: Dialect) -> list[MessageType]:
    """Return our own messages of the serial link to the board."""
    return [message for message in dialect.messages if message.name.startswith(BOARD)]


def robot(dialect: Dialect) -> list[MessageType]:
    """Return our own messages of the control loop and of runs."""
    others = {*common(dialect), *operator(dialect), *board(dialect)}
    return [message for message in dialect.messages if message not in others]


def messages(dialect: Dialect) -> str:
    """Return the module that re-exports all messages."""
    groups = {"board": board, "common": common, "operator": operator, "robot": robot}
    imports = {f"{package()}.messages_{name}": names(of(dialect)) for name, of in groups.items()}
    every = names(dialect.messages)
    exported = sorted(["Message", *every], key=str.lower)
    return module(
        "All messages of the dialect: one frozen, keyword-only class per message.",
        ["", "from typing import Final", ""],
        import_lines(f"{package()}.message", ["Message"]),
        (line for source, classes in imports.items() for line in import_lines(source, classes)),
        ["", *table_lines("__all__ = [", map(quoted, ["MESSAGES", *exported]), "]"), ""],
        table_lines("MESSAGES: Final[tuple[type[Message], ...]] = (", every, ")"),
    )


def enums(dialect: Dialect) -> str:
    """Return the module of enumerations, and of single numbers of further enumerations."""
    classes = [line for name in ENUM_CLASSES for line in class_lines(dialect.enums[name])]
    singles = [
        entry._replace(name=f"{prefix}_{entry.name}")
        for name, prefix in CONSTANTS.items()
        for entry in dialect.enums[name].entries
    ]
    return module(
        "The enumerations of the dialect.",
        ["", "from enum import IntEnum", "from typing import Final"],
        classes,
        ["", "", *constant_lines(singles)],
    )


def class_lines(enum: EnumType) -> Iterator[str]:
    """Yield the class of an enumeration."""
    return enum_lines(ENUM_CLASSES[enum.name], enum, COMMON_TEXTS.get(enum.name, enum.text))


def reasons(dialect: Dialect) -> str:
    """Return the module of reasons: numbers and texts."""
    enum = dialect.enums[REASON]
    plain = enum._replace(entries=tuple(entry._replace(text="") for entry in enum.entries))
    rows = (f"{entry.value}: {quoted(entry.words)}" for entry in enum.entries)
    return module(
        "Numbers and texts of the reasons of every refusal, stop and outcome.",
        ["", "from enum import IntEnum", "from typing import Final"],
        enum_lines("Reason", plain, enum.text),
        ["", "", *table_lines("REASON_TEXTS: Final[dict[int, str]] = {", rows, "}")],
        ["", "", "def reason_text(code: int) -> str:"],
        ['    """Return the text of a reason; an unknown code is shown as a number."""'],
        ['    return REASON_TEXTS.get(code, f"reason {code}")'],
    )


def layouts(dialect: Dialect) -> str:
    """Return the module of wire layouts."""
    return module(
        "Wire layouts of the messages.",
        ["", "from typing import Final", ""],
        ["# NAME id crc_extra field:[array length]struct-code ... in wire order"],
        ['LAYOUTS: Final = """'],
        (line for message in dialect.messages for line in layout_lines(message)),
        ['"""'],
    )


def core_reasons(dialect: Dialect) -> str:
    """Return the core's module of reasons."""
    docstring = "Numbers of the reasons of every refusal, stop and outcome."
    return core_module(docstring, [core_entries(dialect.enums[REASON])])


def core_states(dialect: Dialect) -> str:
    """Return the core's module of states."""
    docstring = "Numbers of vehicle, mode, goal, navigator and branch states, of bumpers and sides."
    states = [core_entries(dialect.enums[name]) for name in CORE_STATES]
    return core_module(docstring, [*states, SIDES])


def core_module(docstring: str, groups: Iterable[Iterable[Entry]]) -> str:
    """Return a module of constants for the core."""
    blocks = (["", *constant_lines(group)] for group in groups)
    imports = ["", "from typing import Final"]
    return module(docstring, imports, *blocks)


def core_entries(enum: EnumType) -> list[Entry]:
    """Return the members of an enumeration by their names in the core."""
    return [
        entry._replace(name=CORE_NAMES.get((enum.name, entry.name), entry.name), text=entry.words)
        for entry in enum.entries
    ]


def limits(dialect: Dialect) -> str:
    """Return the module of limits: largest values of fields, and timeouts of streams."""
    docstring = f"Times-to-live, timeouts and sizes shared by robot, plant and operators. {SOURCE}"
    imports = ["", "from typing import Final"]
    largest = [
        Entry(MAX_NAMES[message.name, field.name], int(field.maximum or field.length), "")
        for message in dialect.messages
        for field in message.fields
        if field.maximum or (message.name, field.name) in MAX_NAMES
    ]
    lines = [["", *constant_lines(entries)] for entries in (largest, lost_after(dialect))]
    return module(docstring, imports, *lines)


def core_limits(dialect: Dialect) -> str:
    """Return the core's module of timeouts."""
    docstring = f"Timeouts after which a stream is lost. {SOURCE}"
    return core_module(docstring, [lost_after(dialect)])


def lost_after(dialect: Dialect) -> list[Entry]:
    """Return the timeouts of reasons, in milliseconds; of a parameter the default."""
    return [
        Entry(f"{entry.name}_MS", entry.timeout_ms, entry.text)
        for entry in dialect.enums[REASON].entries
        if entry.timeout_ms
    ]


def names(messages: Iterable[MessageType]) -> list[str]:
    """Return the class names of messages."""
    return [class_name(message.name) for message in messages]


def quoted(text: str) -> str:
    """Return a Python string literal."""
    assert '"' not in text
    assert "\\" not in text
    return f'"{text}"'


def package() -> str:
    """Return the package of the typed messages."""
    return WIRE.replace("/", ".")


CLASS_OF_ENUM: Final = {**ENUM_CLASSES, REASON: "Reason"}
NAMES_OF_ENUM: Final = CLASS_OF_ENUM | {name: f"{one}_*" for name, one in CONSTANTS.items()}
OUTPUTS: Final[dict[str, Callable[[Dialect], str]]] = {
    f"{WIRE}/messages.py": messages,
    f"{WIRE}/messages_board.py": messages_board,
    f"{WIRE}/messages_common.py": messages_common,
    f"{WIRE}/messages_operator.py": messages_operator,
    f"{WIRE}/messages_robot.py": messages_robot,
    f"{WIRE}/enums.py": enums,
    f"{WIRE}/reasons.py": reasons,
    f"{WIRE}/limits.py": limits,
    f"{CORE}/limits.py": core_limits,
    f"{CORE}/reasons.py": core_reasons,
    f"{CORE}/states.py": core_states,
    "protocol/dialect/layouts.py": layouts,
}
"""Generators of all modules, by path from the root."""


def main() -> None:
    """Write all generated modules."""
    dialect = read_dialect()
    for path, text_of in OUTPUTS.items():
        (ROOT / path).write_text(text_of(dialect), encoding="utf-8")


if __name__ == "__main__":
    main()
