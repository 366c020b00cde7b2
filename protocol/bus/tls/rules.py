"""Zenoh's access control rules, derived from the permissions of each certificate; default deny.

A listening process enforces them on incoming and outgoing messages of each link. The rules name
every robot and every key that may be published or queried, so no wildcard matches one. A process
that dials enforces the same rules from its side: it accepts data only from a router or its own
robot, and only what its own role needs.

No rule about what may come in contains `**`, so none includes a pattern with one.
"""

from collections.abc import Iterable, Mapping
from typing import Final, TypeAlias

from protocol.bus.network import Network
from protocol.bus.tls.role_grants import OPERATOR, ROBOT, ROUTER, Grant, grant_of, grants
from protocol.topics import TOPICS, path_of

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
