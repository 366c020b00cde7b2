"""Zenoh's access control rules, derived from the permissions of each certificate; default deny.

A listening process enforces them on incoming and outgoing messages of each link. The rules name
every robot and every key that may be published or queried, so no wildcard matches one. A process
that dials enforces the same rules from its side: it accepts data only from a router or its own
robot, and only what its own role needs.
"""

from collections.abc import Iterable, Mapping
from typing import Final, TypeAlias

from protocol.bus.network import Network
from protocol.bus.tls.role_grants import ALL, OPERATOR, ROBOT, ROUTER, Grant, grant_of, grants

Rule: TypeAlias = dict[str, object]
Table: TypeAlias = Mapping[tuple[str, ...], tuple[str, ...]]
"""Key expressions by kinds of messages."""

PRESENCE: Final = "alive/**"
EVERYTHING: Final = ("**", "**/@adv/**", "@/**")
EVERY_KIND: Final = (
    "put",
    "delete",
    "query",
    "reply",
    "declare_subscriber",
    "declare_queryable",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
)


def access_control(network: Network) -> dict[str, object]:
    """Return Zenoh's `access_control` of a listening process."""
    found = grants(network.robots, network.operators)
    return control(
        {
            name: rules_of(name, grant, network.prefix)
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
    prefix, operators = network.prefix, (own.removeprefix(OPERATOR),) * own.startswith(OPERATOR)
    robots = (own.removeprefix(ROBOT),) if own.startswith(ROBOT) else network.robots
    found = {ROUTER: from_dialled(ROUTER, grants(robots, operators)[own], prefix)}
    for robot in () if own.startswith(ROBOT) else robots:
        grant = grants((robot,), operators)[own]
        found[ROBOT + robot] = from_dialled(ROBOT + robot, grant, prefix, robot)
    return control({name: of_one for name, of_one in found.items() if name not in network.revoked})


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


def rules_of(name: str, grant: Grant, prefix: str) -> list[Rule]:
    """Return one rule for each kind of message from the holder, and to it."""
    come, go = tables(grant)
    return [*rules(name, "ingress", come, prefix), *rules(name, "egress", go, prefix)]


def from_dialled(name: str, own: Grant, prefix: str, robot: str = "") -> list[Rule]:
    """Return the rules for a dialled process: it may bring what our grant `own` needs.

    A robot brings only data about `robot`. Everything may be sent to a dialled process: it has
    rules of its own.
    """
    _, come = tables(own, robot or "*")
    sent: Rule = {
        "id": f"{name} egress",
        "permission": "allow",
        "flows": ["egress"],
        "messages": list(EVERY_KIND),
        "key_exprs": list(EVERYTHING),
    }
    return [*rules(name, "ingress", come, prefix), sent]


def tables(grant: Grant, about: str = "*") -> tuple[Table, Table]:
    """Return what may come from the holder, and what may go to it, by kinds of message.

    `about` restricts both to one robot.
    """
    everything = ALL if about == "*" else (f"{about}/**",)
    subscribes = everything if grant.subscribes == ALL else grant.subscribes
    fetches = everything if grant.fetches == ALL else grant.fetches
    presence_of = (f"{about}/{PRESENCE}",)
    put, fetched = kept(grant.puts), kept(fetches)
    presence = ("declare_liveliness_subscriber", "liveliness_query")
    come: Table = {
        ("put",): grant.puts + put,
        ("declare_subscriber",): subscribes + fetched,
        ("query",): grant.asks + fetched,
        ("declare_queryable",): grant.answers + put,
        ("reply",): grant.answers + grant.puts + put,
        ("liveliness_token",): grant.shows + put,
        presence: presence_of + fetched,
    }
    go: Table = {
        ("put",): subscribes + fetched,
        ("query",): grant.answers + put,
        ("reply",): grant.asks + subscribes + fetched,
        ("liveliness_token",): presence_of + fetched,
        ("declare_subscriber", "declare_queryable", *presence): ALL + kept(ALL),
    }
    return come, go


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
    """Return the keys on which Zenoh caches the events of these keys, and fetches them."""
    return tuple(f"{path}/@adv/**" for path in paths)
