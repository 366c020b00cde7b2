"""Derive the rights of each certificate from the tables of topics and services."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

from protocol.topic import RESERVED, ROBOT_NAME, operator_called
from protocol.topics import MARK, SERVICES, TEXT, TOPICS, Role, Service, Topic, robot_name

ROUTER: Final = "router"
PLANT: Final = "plant"
GROUND: Final = "ground"
VIEWER: Final = "viewer"
RECORDER: Final = "recorder"
ROBOT: Final = "robot-"
OPERATOR: Final = "ground-"
OPEN: Final = "open"
ALL: Final = ("**",)
DRIVE: Final = "drive/"
TRUTH: Final = "truth/"
FOR_VIEWERS: Final = (TEXT, MARK)
"""What was asked of a robot, and answered, is long: of these a viewer hears only what is new."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Grant:
    """What the holder of a certificate may do: key expressions below the prefix."""

    says: str
    puts: tuple[str, ...] = ()
    hears: tuple[str, ...] = ()
    fetches: tuple[str, ...] = ()
    """Keys whose cached events the holder may fetch."""

    asks: tuple[str, ...] = ()
    answers: tuple[str, ...] = ()
    shows: tuple[str, ...] = ()
    """Liveliness tokens."""


def grants(robots: Iterable[str], operators: Iterable[str] = ()) -> dict[str, Grant]:
    """By the common name of the certificate, for the robots and operators that there may be."""
    names = tuple(robot_name(robot) for robot in robots)
    found = {
        ROUTER: Grant(
            says="passes on what it lets through",
            puts=ALL,
            hears=ALL,
            fetches=ALL,
            asks=ALL,
            answers=ALL,
            shows=ALL,
        ),
        PLANT: granted("senses and drives the robots", Role.PLANT, names),
        GROUND: granted("commands the robots", Role.GROUND, names, GROUND),
        VIEWER: Grant(
            says="only listens",
            hears=ALL,
            fetches=keys(names, FOR_VIEWERS, "**"),
            asks=keys(names, open_to_all()),
        ),
        RECORDER: Grant(
            says="listens and records", hears=ALL, fetches=ALL, asks=keys(names, open_to_all())
        ),
    }
    for operator in operators:
        says = f"commands the robots as {operator}"
        found[OPERATOR + operator] = granted(says, Role.GROUND, names, operator_called(operator))
    for name in names:
        found[ROBOT + name] = granted(f"is the robot {name}", Role.ROBOT, (name,))
    return found


def grant_of(name: str, robot: str = "") -> Grant | None:
    """Return the rights of a certificate; None if it has none.

    It is about `robot`; without one about that of the certificate, if it is a robot's.
    """
    robot = robot or name.removeprefix(ROBOT)
    operator = name.removeprefix(OPERATOR)
    is_operator = name != operator and ROBOT_NAME.match(operator) and operator not in RESERVED
    robots = (robot,) if ROBOT_NAME.match(robot) else ()
    return grants(robots, (operator,) if is_operator else ()).get(name)


def operator_name(name: str | None) -> str | None:
    """Return the operator's name in a certificate's common name; None when it names none.

    On an open bus (`name` None) every operator is called OPEN.
    """
    if name is None or name == ROUTER:
        return OPEN
    if name == GROUND:
        return GROUND
    return name.removeprefix(OPERATOR) if name.startswith(OPERATOR) else None


def barred(name: str | None, robot: str, service: Service) -> str:
    """Why the holder of a certificate may not ask a robot's service; empty when it may.

    `name` is the common name; None where no door is locked.
    """
    if name is None:
        return ""
    grant = grant_of(name, robot) or grant_of(name)
    if grant is None:
        return f"the certificate in use is that of {name!r}, which is no role: it may do nothing"
    asked = f"{robot}/{service.path}"
    if any(f"{key}/".startswith(f"{asked}/") for key in grant.asks):
        return ""
    may_not = f"and may not ask {service.path}"
    return f"the certificate in use is that of {name!r}, which {grant.says} {may_not}"


def may_fetch(name: str | None, robot: str, topic: Topic[Any]) -> bool:
    """Return whether the holder of a certificate may ask for what a topic's senders have kept."""
    grant = None if name is None else grant_of(name, robot)
    if name is None or grant is None or grant.fetches == ALL:
        return True
    return any(f"{key}/".startswith(f"{robot}/{topic.path}/") for key in grant.fetches)


def misfit(name: str | None, role: Role | None, robot: str) -> str:
    """Why a certificate is none for a process of this role; empty when it is one."""
    needed = {Role.PLANT: PLANT, Role.ROBOT: ROBOT + robot}.get(role or Role.GROUND)
    if name is None or needed is None or name in (needed, ROUTER):
        return ""
    return (
        f"the certificate in use is that of {name!r}, and this process needs that of {needed!r}: "
        f"use --config DIR/{needed}.toml"
    )


def impostor(name: str | None, own: str, robot: str) -> str:
    """Return why this process must not dial the holder of a certificate; empty if it may.

    `own` is the common name of the certificate of this process, `robot` the robot it is about.
    """
    if name == ROUTER or (name == ROBOT + robot and not own.startswith(ROBOT)):
        return ""
    wanted = "a router" if own.startswith(ROBOT) else f"a router or the robot {robot}"
    return f"shows the certificate of {name or 'nobody'!r}, and {own} dials only {wanted}"


def unanswered(name: str | None, robot: str, service: Service) -> str:
    """Why a question came back empty at once."""
    nobody = f"nobody serves it (is the {service.server.value} running?)"
    return barred(name, robot, service) or nobody


def granted(says: str, role: Role, names: tuple[str, ...], operator: str = "") -> Grant:
    """What the tables give to a role: to an operator only keys that name it, of any session."""
    ground = role is Role.GROUND
    speaks = f"{operator}/*" if ground else ""
    heard = keys(names, [topic for topic in TOPICS if told(topic, role)], "**")
    return Grant(
        says=says,
        puts=keys(names, (topic for topic in TOPICS if topic.publisher is role), speaks),
        hears=ALL if ground else heard,
        fetches=ALL if ground else heard,
        asks=keys(names, SERVICES, speaks) if ground else (),
        answers=keys(names, (service for service in SERVICES if service.server is role), "**"),
        shows=tuple(f"{name}/alive/{role.value}/*" for name in names),
    )


def told(topic: Topic[Any], role: Role) -> bool:
    """Is it for this role? Drive commands are for the plant, senses and operators for robots.

    What a role says itself it may hear, too: that is how it is asked whether it is well.
    """
    if topic.publisher is role:
        return True
    if role is Role.PLANT:
        return topic.path.startswith(DRIVE)
    return topic.publisher is not Role.ROBOT and not topic.path.startswith(TRUTH)


def open_to_all() -> tuple[Service, ...]:
    """Questions that carry nothing change nothing."""
    return tuple(service for service in SERVICES if not service.requests)


def keys(
    names: Iterable[str], table: Iterable[Topic[Any] | Service], operator: str = ""
) -> tuple[str, ...]:
    """Return the keys of these topics and services of these robots.

    `operator` is appended to those that end in the identity of an operator.
    """
    paths = [
        f"{entry.path}/{operator}" if operator and entry.of_operators else entry.path
        for entry in table
    ]
    return tuple(f"{name}/{path}" for name in names for path in paths)
