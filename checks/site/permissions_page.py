"""Table of the permissions of each certificate, derived from the rules given to Zenoh."""

from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any, Final, NamedTuple

import zenoh

from protocol.bus.network import Network
from protocol.bus.rights import (
    GATEWAY,
    GROUND,
    OPERATOR,
    PLANT,
    RECORDER,
    ROBOT,
    ROUTER,
    VIEWER,
    access_control,
    impostor,
)
from protocol.topics import (
    COMMAND,
    COMMANDED,
    DRIVE,
    LEASE_SERVICE,
    MISSION_SERVICE,
    PARAMETER,
    PARAMETERS,
    RUN,
    SONAR,
    STATUS,
    STOP,
    STOP_SERVICE,
    TELEOP,
    TEXT,
    TRUTH,
)

OURS: Final = "r1"
OTHERS: Final = "r2"
NAME: Final = "ada"
OTHER_NAME: Final = "bob"
NETWORK: Final = Network(robots=(OURS, OTHERS), operators=(NAME, OTHER_NAME))
OPEN: Final = "open bus: any process"
NONE: Final = "any other, or revoked"
COLUMNS: Final = (
    (VIEWER, VIEWER),
    (RECORDER, RECORDER),
    (GATEWAY, GATEWAY),
    (GROUND, GROUND),
    (OPERATOR + NAME, f"{OPERATOR}NAME"),
    (PLANT, PLANT),
    (ROBOT + OURS, f"{ROBOT}NAME, of NAME"),
    (ROBOT + OTHERS, f"{ROBOT}NAME, of others"),
    (ROUTER, ROUTER),
    ("stranger", NONE),
)
"""Common name of a certificate, and its title in the table. All rows are about robot OURS."""

LISTEN: Final = ("egress", "put")
PUT: Final = ("ingress", "put")
ASK: Final = ("ingress", "query")
ANSWER: Final = ("ingress", "reply")
SHOW: Final = ("ingress", "liveliness_token")
YES: Final = "yes"
NO: Final = "no"


class Permission(NamedTuple):
    """An ability of a certificate holder: a kind of message on `path` or on `or_path`.

    In a path `{own}` is the holder's operator name, and `{other}` that of another operator.
    """

    description: str
    kind: tuple[str, str]
    path: str
    or_path: str = ""


OWN: Final = "{own}/1"
FOREIGN: Final = "{other}/1"
KEPT: Final = "@adv/pub/1/1/_"
ABILITIES: Final = (
    Permission("receive telemetry", LISTEN, STATUS.path),
    Permission("receive samples of operators", LISTEN, f"{TELEOP.path}/{FOREIGN}"),
    Permission("receive ground truth of the simulation", LISTEN, TRUTH.path),
    Permission("fetch missed texts", ASK, f"{TEXT.path}/{KEPT}"),
    Permission("fetch missed commands and answers", ASK, f"{COMMANDED.path}/{KEPT}"),
    Permission("read the parameters", ASK, PARAMETERS.path, f"{PARAMETERS.path}/{OWN}"),
    Permission("stop the robot", PUT, f"{STOP.path}/{OWN}"),
    Permission("stop the robot and receive its answer", ASK, f"{STOP_SERVICE.path}/{OWN}"),
    Permission("take or seize the lease", ASK, f"{LEASE_SERVICE.path}/{OWN}"),
    Permission("hold, abort, disarm", ASK, f"{COMMAND.path}/{OWN}"),
    Permission(
        "arm, send to a goal, resume (unless another operator has the lease)",
        ASK,
        f"{COMMAND.path}/{OWN}",
    ),
    Permission("drive by hand (likewise)", PUT, f"{TELEOP.path}/{OWN}"),
    Permission("set a parameter (likewise)", ASK, f"{PARAMETER.path}/{OWN}"),
    Permission("load a mission or fence (likewise)", ASK, f"{MISSION_SERVICE.path}/{OWN}"),
    Permission("command as another operator, under its lease", ASK, f"{COMMAND.path}/{FOREIGN}"),
    Permission("pause or score a simulated run", ASK, RUN.path),
    Permission("publish sensor data of the robot", PUT, SONAR.path),
    Permission("command the wheels directly", PUT, DRIVE.path),
    Permission("publish telemetry as the robot", PUT, STATUS.path),
    Permission("answer as the robot", ANSWER, f"{COMMAND.path}/{OWN}"),
    Permission("announce itself as the robot", SHOW, "alive/robot/1"),
)
DIALLED: Final = (
    ("be accepted by a robot that dials it", ROBOT + OURS),
    ("be accepted by the plant, an operator or a viewer that dials it", GROUND),
)


def rows() -> Iterator[Sequence[str]]:
    """Yield each ability, whether an open bus permits it, and whether each certificate does."""
    for ability in ABILITIES:
        yield ability.description, YES, *(answer(may(name, ability)) for name, _ in COLUMNS)
    for description, own in DIALLED:
        yield description, YES, *(answer(not impostor(name, own, OURS)) for name, _ in COLUMNS)


def head() -> Sequence[str]:
    """Return the column titles."""
    return "can", OPEN, *(f"`{shown}`" if shown != NONE else shown for _, shown in COLUMNS)


def answer(may: bool) -> str:
    """Return yes or no."""
    return YES if may else NO


def may(name: str, ability: Permission) -> bool:
    """Return whether the rules permit an ability on robot OURS."""
    own = name.removeprefix(OPERATOR)
    other = OTHER_NAME if own == NAME else NAME
    paths = (path.format(own=own, other=other) for path in ability[2:] if path)
    return any(allowed(name, ability.kind, f"{NETWORK.prefix}/{OURS}/{path}") for path in paths)


def allowed(name: str, kind: tuple[str, str], key: str) -> bool:
    """Return whether a rule for this certificate covers a kind of message on a key."""
    flow, message = kind
    return any(
        zenoh.KeyExpr(expression).includes(zenoh.KeyExpr(key))
        for rule in rules()
        if rule["id"].startswith(f"{name} ")
        and flow in rule["flows"]
        and message in rule["messages"]
        for expression in rule["key_exprs"]
    )


@cache
def rules() -> list[dict[str, Any]]:
    """Return the rules that a listening process gives to Zenoh."""
    found = access_control(NETWORK)["rules"]
    assert isinstance(found, list)
    return found
