"""Permissions of each certificate by the tables of topics and services, as Zenoh's access control.

Everything else is denied. A listening process enforces the rules on incoming and outgoing messages
of each link. The rules name every robot and every key that may be published or queried, so no
wildcard matches one. A process that dials enforces the same rules from its side: it accepts data
only from a router or its own robot, and only what its own role needs.

No rule about what may come in contains `**`, so none includes a pattern with one.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, TypeAlias

from protocol.bus.network import Network
from protocol.topic import RESERVED, ROBOT_NAME, operator_called
from protocol.topics import (
    CLOCK_SERVICE,
    COMMAND,
    CYCLE,
    HEARTBEAT,
    LEASE,
    LEASE_SERVICE,
    MARK,
    MISSION,
    MISSION_SERVICE,
    ODOMETRY,
    PARAMETER,
    PARAMETERS,
    SERVICES,
    SONAR,
    STATUS,
    STOP,
    STOP_SERVICE,
    TELEOP,
    TEXT,
    TOPICS,
    WHEELS,
    Role,
    Service,
    Topic,
    path_of,
    robot_name,
)
from protocol.topics import GATEWAY as GATEWAY_STATE
from protocol.topics import OPERATOR as OPERATOR_HEARTBEAT

ROUTER: Final = "router"
PLANT: Final = "plant"
GROUND: Final = "ground"
VIEWER: Final = "viewer"
RECORDER: Final = "recorder"
GATEWAY: Final = "gateway"
ROBOT: Final = "robot-"
OPERATOR: Final = "ground-"
OPEN: Final = "open"
ANYONE: Final = "*/*"
"""Any identity of an operator at the end of a key."""

DRIVE: Final = "drive/"
TRUTH: Final = "truth/"
HISTORIES: Final = tuple(topic for topic in TOPICS if topic.history)
FOR_VIEWERS: Final = (TEXT, MARK)
"""Topics whose cached samples a viewer may fetch. The histories of requests and answers are long:
a viewer receives only new ones."""

GATEWAY_PUTS: Final = (OPERATOR_HEARTBEAT, TELEOP, STOP, GATEWAY_STATE)
GATEWAY_RECEIVES: Final = (
    STATUS,
    ODOMETRY,
    SONAR,
    WHEELS,
    LEASE,
    MISSION,
    CYCLE,
    TEXT,
    HEARTBEAT,
)
GATEWAY_ASKS: Final = (
    COMMAND,
    STOP_SERVICE,
    PARAMETER,
    PARAMETERS,
    LEASE_SERVICE,
    MISSION_SERVICE,
    CLOCK_SERVICE,
)
"""MAVLink clients need no ground truth, no data of other operators, and no change of the run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Grant:
    """Permissions of a certificate: key expressions below the prefix.

    Each names a topic or service. None contains `**`: its holder could declare every pattern that
    it includes, and to match one with many `**` takes exponential time and memory.
    """

    description: str
    puts: tuple[str, ...] = ()
    subscribes: tuple[str, ...] = ()
    fetches: tuple[str, ...] = ()
    """Keys whose cached events may be fetched."""

    asks: tuple[str, ...] = ()
    answers: tuple[str, ...] = ()
    shows: tuple[str, ...] = ()
    """Liveliness tokens."""


def grants(robots: Iterable[str], operators: Iterable[str] = ()) -> dict[str, Grant]:
    """Return the permissions by common name, for the given robots and operators."""
    names = tuple(robot_name(robot) for robot in robots)
    found = {
        ROUTER: router_grant(names),
        PLANT: granted("simulates the robots", Role.PLANT, names),
        GROUND: granted("commands the robots", Role.GROUND, names, GROUND),
        VIEWER: Grant(
            description="only observes",
            subscribes=every_key(names, TOPICS),
            fetches=every_key(names, FOR_VIEWERS),
            asks=keys(names, open_to_all()),
        ),
        RECORDER: Grant(
            description="observes and records",
            subscribes=every_key(names, TOPICS),
            fetches=every_key(names, HISTORIES),
            asks=keys(names, open_to_all()),
        ),
        GATEWAY: gateway_grant(names),
    }
    for operator in operators:
        description = f"commands the robots as {operator}"
        found[OPERATOR + operator] = granted(
            description, Role.GROUND, names, operator_called(operator)
        )
    for name in names:
        found[ROBOT + name] = granted(f"is the robot {name}", Role.ROBOT, (name,))
    return found


def router_grant(names: tuple[str, ...]) -> Grant:
    """Return the permissions of a router: everything that other certificates permit."""
    topics, services = every_key(names, TOPICS), every_key(names, SERVICES)
    return Grant(
        description="forwards the messages that the rules permit",
        puts=topics,
        subscribes=topics,
        fetches=every_key(names, HISTORIES),
        asks=services,
        answers=services,
        shows=tuple(f"{name}/alive/*/*" for name in names),
    )


def gateway_grant(names: tuple[str, ...]) -> Grant:
    """Return the permissions of the MAVLink gateway: only those that its clients need."""
    return Grant(
        description="sends commands to the robots for MAVLink clients",
        puts=keys(names, GATEWAY_PUTS, f"{GATEWAY}/*"),
        subscribes=keys(names, GATEWAY_RECEIVES),
        fetches=keys(names, (TEXT,)),
        asks=keys(names, GATEWAY_ASKS, f"{GATEWAY}/*"),
        shows=tuple(f"{name}/alive/{Role.GROUND.value}/*" for name in names),
    )


def grant_of(name: str, robot: str = "") -> Grant | None:
    """Return the permissions of a certificate; None if its name is not that of a role.

    They are about `robot`; by default, for a robot's certificate, about itself.
    """
    robot = robot or name.removeprefix(ROBOT)
    operator = name.removeprefix(OPERATOR)
    is_operator = name != operator and ROBOT_NAME.match(operator) and operator not in RESERVED
    robots = (robot,) if ROBOT_NAME.match(robot) else ()
    return grants(robots, (operator,) if is_operator else ()).get(name)


def operator_name(name: str | None) -> str | None:
    """Return the operator's name in a certificate's common name; None if it contains none.

    On an open bus (`name` None) no certificate names the operator: OPEN stands for any.
    """
    if name is None or name == ROUTER:
        return OPEN
    if name in (GROUND, GATEWAY):
        return name
    return name.removeprefix(OPERATOR) if name.startswith(OPERATOR) else None


def denial(name: str | None, robot: str, service: Service) -> str:
    """Return why a certificate does not permit a query of a robot's service; empty if it does.

    `name` is the common name; None without TLS.
    """
    if name is None:
        return ""
    grant = grant_of(name, robot) or grant_of(name)
    if grant is None:
        return f"the certificate in use is that of {name!r}, which is no role: it permits nothing"
    path = f"{robot}/{service.path}"
    if any(f"{key}/".startswith(f"{path}/") for key in grant.asks):
        return ""
    may_not = f"and may not query {service.path}"
    return f"the certificate in use is that of {name!r}, which {grant.description} {may_not}"


def may_fetch(name: str | None, robot: str, topic: Topic[Any]) -> bool:
    """Return whether a certificate permits fetching the cached samples of a topic."""
    grant = None if name is None else grant_of(name, robot)
    if name is None or grant is None:
        return True
    return any(f"{key}/".startswith(f"{robot}/{topic.path}/") for key in grant.fetches)


def role_mismatch(name: str | None, role: Role | None, robot: str) -> str:
    """Return why a certificate does not fit a process of this role; empty if it does."""
    needed = {Role.PLANT: PLANT, Role.DRIVER: PLANT, Role.ROBOT: ROBOT + robot}.get(
        role or Role.GROUND
    )
    if name is None or needed is None or name in (needed, ROUTER):
        return ""
    return (
        f"the certificate in use is that of {name!r}, and this process needs that of {needed!r}: "
        f"use --config DIR/{needed}.toml"
    )


def impostor(name: str | None, own: str, robot: str) -> str:
    """Return why this process must not dial the holder of a certificate; empty if it may.

    `own` is the common name of this process's certificate, `robot` the robot it works for.
    """
    if name == ROUTER or (name == ROBOT + robot and not own.startswith(ROBOT)):
        return ""
    wanted = "a router" if own.startswith(ROBOT) else f"a router or the robot {robot}"
    return f"shows the certificate of {name or '(no name)'!r}, and {own} dials only {wanted}"


def unanswered(name: str | None, robot: str, service: Service) -> str:
    """Return why a query came back empty at once."""
    unserved = f"no process serves it (is the {service.server.value} running?)"
    return denial(name, robot, service) or unserved


def granted(description: str, role: Role, names: tuple[str, ...], operator: str = "") -> Grant:
    """Return the permissions of a role; an operator's apply only to keys that contain its name."""
    ground = role is Role.GROUND
    identity = f"{operator}/*" if ground else ""
    received = [topic for topic in TOPICS if ground or is_for(topic, role)]
    return Grant(
        description=description,
        puts=keys(names, (topic for topic in TOPICS if topic.publisher is role), identity),
        subscribes=every_key(names, received),
        fetches=every_key(names, (topic for topic in received if topic.history)),
        asks=keys(names, SERVICES, identity) if ground else (),
        answers=every_key(names, (service for service in SERVICES if service.server is role)),
        shows=tuple(
            f"{name}/alive/{one.value}/*" for name in names for one in SHOWN.get(role, (role,))
        ),
    )


SHOWN: Final[Mapping[Role, tuple[Role, ...]]] = MappingProxyType(
    {Role.PLANT: (Role.PLANT, Role.DRIVER)}
)
"""A driver has the certificate of the plant in whose place it is."""


def is_for(topic: Topic[Any], role: Role) -> bool:
    """Return whether a role subscribes to a topic.

    Drive commands are for the plant; sensor data and operators' topics are for robots. A role may
    also subscribe to its own topics: so its health check can receive them.
    """
    if topic.publisher is role:
        return True
    if role is Role.PLANT:
        return topic.path.startswith(DRIVE)
    return topic.publisher is not Role.ROBOT and not topic.path.startswith(TRUTH)


def open_to_all() -> tuple[Service, ...]:
    """Return the services without a request payload: they change nothing."""
    return tuple(service for service in SERVICES if not service.requests)


def every_key(names: Iterable[str], table: Iterable[Topic[Any] | Service]) -> tuple[str, ...]:
    """Return the keys of these topics and services for these robots, with any operator."""
    paths = [f"{entry.path}{end}" for entry in table for end in ends_of(entry)]
    return tuple(f"{name}/{path}" for name in names for path in paths)


def ends_of(entry: Topic[Any] | Service) -> tuple[str, ...]:
    """Return what the keys of a topic or service end in: the identity of an operator, or nothing.

    Services answer processes without an identity, too, and an emergency stop needs none.
    """
    if not entry.of_operators:
        return ("",)
    return ("", f"/{ANYONE}") if isinstance(entry, Service) or entry is STOP else (f"/{ANYONE}",)


def keys(
    names: Iterable[str], table: Iterable[Topic[Any] | Service], operator: str = ""
) -> tuple[str, ...]:
    """Return the keys of these topics and services for these robots.

    `operator` is appended to keys that end in the identity of an operator.
    """
    paths = [
        f"{entry.path}/{operator}" if operator and entry.of_operators else entry.path
        for entry in table
    ]
    return tuple(f"{name}/{path}" for name in names for path in paths)


Rule: TypeAlias = dict[str, object]
Table: TypeAlias = Mapping[tuple[str, ...], tuple[str, ...]]
"""Key expressions by kinds of messages."""

PRESENCE: Final = "alive/*/*"
KEPT: Final = "@adv/pub/*/*/_"
"""Below the key of a topic with a history: session and number of a sender."""

WITH_HISTORY: Final = frozenset(topic.path for topic in TOPICS if topic.history)
EVERYTHING: Final = ("**", "**/@adv/**", "@/**")
"""What a process may send to one that it dials."""

WATCHING: Final = ("declare_liveliness_subscriber", "liveliness_query")
EVERY_KIND: Final = (
    "put",
    "delete",
    "query",
    "reply",
    "declare_subscriber",
    "declare_queryable",
    "liveliness_token",
    *WATCHING,
)


def access_control(network: Network) -> dict[str, object]:
    """Return Zenoh's `access_control` of a listening process."""
    found = grants(network.robots, network.operators)
    return control(
        {
            name: rules_of(name, grant, found[ROUTER], network.prefix)
            for name, grant in found.items()
            if name not in network.revoked
        }
    )


def dialled_access_control(network: Network, own: str) -> dict[str, object]:
    """Return Zenoh's `access_control` of a process that dials, by its common name.

    A router brings the data for this role; a robot that listens brings data about itself. Any other
    process brings and gets nothing. Empty if the certificate has no role.
    """
    if grant_of(own) is None:
        return {}
    operators = (own.removeprefix(OPERATOR),) * own.startswith(OPERATOR)
    robots = (own.removeprefix(ROBOT),) if own.startswith(ROBOT) else network.robots
    holders = {ROUTER: robots} | {
        ROBOT + robot: (robot,) for robot in robots if not own.startswith(ROBOT)
    }
    return control(
        {
            name: from_dialled(name, own, grants(about, operators), network.prefix)
            for name, about in holders.items()
            if name not in network.revoked
        }
    )


def control(by_name: Mapping[str, list[Rule]]) -> dict[str, object]:
    """Return settings that deny everything but the rules of each certificate."""
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule for of_one in by_name.values() for rule in of_one],
        "subjects": [{"id": name, "cert_common_names": [name]} for name in by_name],
        "policies": [
            {"subjects": [name], "rules": [rule["id"] for rule in of_one]}
            for name, of_one in by_name.items()
        ],
    }


def rules_of(name: str, grant: Grant, all_of: Grant, prefix: str) -> list[Rule]:
    """Return one rule for each kind of message from the holder, and to it.

    `all_of` is the grant of a router: everything that anyone may do.
    """
    return [
        *rules(name, "ingress", incoming(grant), prefix),
        *rules(name, "egress", outgoing(grant, all_of), prefix),
    ]


def from_dialled(name: str, own: str, found: Mapping[str, Grant], prefix: str) -> list[Rule]:
    """Return the rules for a dialled process: it may bring what our grant needs.

    `own` is our common name, `found` has the grants about the robots of which it brings data.
    Everything may be sent to a dialled process: it has rules of its own.
    """
    robot = name.removeprefix(ROBOT) if name.startswith(ROBOT) else "*"
    come = outgoing(found[own], found[ROUTER], robot)
    sent: Rule = {
        "id": f"{name} egress",
        "permission": "allow",
        "flows": ["egress"],
        "messages": list(EVERY_KIND),
        "key_exprs": list(EVERYTHING),
    }
    return [*rules(name, "ingress", come, prefix), sent]


def incoming(grant: Grant) -> Table:
    """Return what may come from the holder, by kinds of message."""
    put, fetched = kept(grant.puts), kept(grant.fetches)
    return {
        ("put",): grant.puts + put,
        ("declare_subscriber",): grant.subscribes + fetched,
        ("query",): grant.asks + fetched,
        ("declare_queryable",): grant.answers + put,
        ("reply",): grant.answers + grant.puts + put,
        ("liveliness_token",): grant.shows + put,
        WATCHING: (f"*/{PRESENCE}", *fetched),
    }


def outgoing(grant: Grant, all_of: Grant, robot: str = "*") -> Table:
    """Return what may go to the holder, by kinds of message; only the presence of `robot`."""
    put, fetched = kept(grant.puts), kept(grant.fetches)
    presence = (f"{robot}/{PRESENCE}", *fetched)
    return {
        ("put",): grant.subscribes + fetched,
        ("query",): grant.answers + put,
        ("reply",): grant.asks + grant.subscribes + fetched,
        ("liveliness_token",): presence,
        ("declare_subscriber",): all_of.subscribes + kept(all_of.puts),
        ("declare_queryable",): all_of.answers + kept(all_of.puts),
        WATCHING: (f"*/{PRESENCE}", *kept(all_of.puts)),
    }


def rules(name: str, flow: str, table: Table, prefix: str) -> list[Rule]:
    """Return one rule for each kind of message in one direction."""
    return [
        {
            "id": f"{name} {flow} {messages[0]}",
            "permission": "allow",
            "flows": [flow],
            "messages": list(messages),
            "key_exprs": [f"{prefix}/{path}" for path in paths],
        }
        for messages, paths in table.items()
        if paths
    ]


def kept(paths: Iterable[str]) -> tuple[str, ...]:
    """Return the keys on which the events of those keys that have a history are fetched."""
    return tuple(kept_by(path) for path in paths if path_of(path) in WITH_HISTORY)


def kept_by(key: str) -> str:
    """Return the keys on which the senders of a key announce and answer with cached events."""
    return f"{key}/{KEPT}"
