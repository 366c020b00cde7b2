"""Generate docs/reference/protocol.md from topic tables and dialect: `make generate-docs`.

The permissions of each certificate are derived from the rules given to Zenoh.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from typing import Any, Final, NamedTuple

import zenoh

from protocol import topics
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
    grants,
    impostor,
)
from protocol.dialect.definitions import SIDESTEP_XML, entry_in
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
    Service,
    Topic,
)
from protocol.wire.message import LAYOUT, Message, class_name
from runtime.units import NS_PER_MS

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


HEAD: Final = f"""\
<!-- Generated by `make generate-docs` from protocol/topics.py and the dialect. -->

# Messages, topics and services

Every sample and every command query carries one MAVLink 2 frame. Keys begin with `sidestep/` and
the name of the robot, so `sense/sonar` of robot `r1` is `sidestep/r1/sense/sonar`. Frames and units
are those of REP-103: x forward, y left, angles counter-clockwise; metres and radians. Messages of
the control loop contain only integers. The encoding of every sample is `{topics.ENCODING}`.
A sample with another encoding is refused, and the reason names the encoding.
"""

STREAMS: Final = """\
A sample older than *stale after* is treated as missing. The sender of an event topic retains its
newest samples (*kept*). Late joiners and subscribers that were cut off fetch them, with their
original time stamps, from the keys `@adv/pub/*/*/_` below the topic's key. Samples that a process
has not yet sent when it is killed are lost."""

SAMPLE_ROBOT: Final = "r1"
SAMPLE_OPERATOR: Final = "ada"
ACCESS: Final = """\
On an open bus every process can do everything. With access control (`[network.tls]`), a process
that listens allows what the certificate of the other side permits, by its common name, and refuses
everything else. A process that dials accepts only a router or its own robot, and from these only
what its own role needs. The name of an operator is in its certificate: `ground-NAME` commands as
NAME, `ground` as `ground`. Each NAME must be listed in `[network] robots` or `operators`, and must
not be listed in `revoked`. The certificate of the router permits all that the others permit."""

ACCESS_KEYS: Final = """\
The same permissions by keys. Those of `robot-NAME` apply to that robot only, all others to all
robots. Every process may see which processes are present (`alive/`)."""


def page(
    streams: Iterable[Topic[Message]], services: Iterable[Service], dialect: ET.Element
) -> str:
    """Return the whole page as Markdown."""
    stream_head = ("key", "messages", "from", "rate", "stale after", "priority", "content")
    access_head = ("certificate", "publishes", "subscribes", "fetches", "queries", "answers")
    service_head = ("key", "request", "answered by", "content")
    lines = [
        HEAD.rstrip(),
        *section("Streams", STREAMS),
        *table(stream_head, map(stream_row, streams)),
        *section("Services", "Every query is answered; a refusal contains its reason."),
        *table(service_head, map(service_row, services)),
        *section("Permissions", ACCESS),
        *table(head(), rows()),
        "",
        *ACCESS_KEYS.splitlines(),
        "",
        *table(access_head, access_rows()),
        *section("Messages of this project"),
        *flat(map(message_lines, dialect.iterfind("messages/message"))),
        *section("Messages of MAVLink's common dialect in use"),
        *common_lines(dialect),
        *section("Enumerations"),
        *flat(map(enum_lines, dialect.iterfind("enums/enum"))),
    ]
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines)).rstrip() + "\n"


def access_rows() -> Iterator[Sequence[str]]:
    """Yield the grants of each certificate, without the robot name that each key begins with."""
    for name, grant in grants((SAMPLE_ROBOT,), (SAMPLE_OPERATOR,)).items():
        lists = (grant.puts, grant.subscribes, grant.fetches, grant.asks, grant.answers)
        certificate = name.replace(SAMPLE_ROBOT, "NAME").replace(SAMPLE_OPERATOR, "NAME")
        cells = (families(paths).replace(SAMPLE_OPERATOR, "NAME") for paths in lists)
        yield f"`{certificate}`", *cells


def families(paths: Iterable[str]) -> str:
    """Return keys as text; merge those with the same first element if the tables have no others."""
    short = [path.partition("/")[2] or "everything" for path in paths]
    whole = {one.path for one in topics.TOPICS} | {one.path for one in topics.SERVICES}
    found: list[str] = []
    for path in short:
        family = path.partition("/")[0] + "/"
        complete = {one for one in whole if one.startswith(family)} <= set(short)
        shown = f"`{family}*`" if complete and path in whole else f"`{path}`"
        if path == "everything":
            shown = path
        if shown not in found:
            found.append(shown)
    return ", ".join(found) or "nothing"


def stream_row(topic: Topic[Message]) -> Sequence[str]:
    """Return the cells of a topic."""
    return (
        f"`{topic.path}`",
        wire_names(topic.messages),
        topic.publisher.value,
        f"{topic.rate_hz:g} Hz" if topic.rate_hz else f"event, {topic.history} kept",
        f"{topic.stale_after_ns // NS_PER_MS} ms" if topic.stale_after_ns else "never",
        topic.priority.name.lower().replace("_", " "),
        topic.doc,
    )


def wire_names(messages: Iterable[type[Message]]) -> str:
    """Return the dialect names of messages."""
    return ", ".join(LAYOUT[message.__name__].name for message in messages)


def service_row(service: Service) -> Sequence[str]:
    """Return the cells of a service."""
    request = wire_names(service.requests) or "nothing"
    return f"`{service.path}`", request, service.server.value, service.doc


def message_lines(message: ET.Element) -> Iterator[str]:
    """Yield the section of a message."""
    name = message.attrib["name"]
    yield from (f"### {name} ({message.attrib['id']})", "", words(message), "")
    yield from table(("field", "type", "unit", "meaning"), map(field_row, message.iter("field")))
    yield ""


def field_row(field: ET.Element) -> Sequence[str]:
    """Return the cells of a field."""
    attributes = field.attrib
    meaning = (field.text or "").strip()
    enum = f" ({attributes['enum']})" if "enum" in attributes else ""
    maximum = f" At most {attributes['maxValue']}." if "maxValue" in attributes else ""
    kind = attributes["type"].replace("_t", "")
    return f"`{attributes['name']}`", kind, attributes.get("units", ""), meaning + enum + maximum


def common_lines(dialect: ET.Element) -> Iterator[str]:
    """Yield the table of the common messages."""
    ours = {class_name(message.attrib["name"]) for message in dialect.iter("message")}
    rows = [layout for name, layout in LAYOUT.items() if name not in ours]
    numbered = sorted(rows, key=lambda layout: layout.number)
    yield from table(
        ("message", "id", "fields"),
        (
            (
                layout.name,
                str(layout.number),
                ", ".join(f"`{field.name}`" for field in layout.fields),
            )
            for layout in numbered
        ),
    )


def enum_lines(enum: ET.Element) -> Iterator[str]:
    """Yield the section of an enumeration."""
    yield from (f"### {enum.attrib['name']}", "", words(enum), "")
    prefix = enum.attrib["name"] + "_"
    entries = (entry_in(element, prefix) for element in enum.iterfind("entry"))
    rows = ((str(entry.value), f"`{entry.name}`", entry.words) for entry in entries)
    yield from table(("value", "name", "meaning"), rows)
    yield ""


def words(element: ET.Element) -> str:
    """Return the description of an element."""
    return (element.findtext("description") or "").strip()


def section(title: str, introduction: str = "") -> tuple[str, ...]:
    """Return a heading and an optional introduction."""
    return ("", f"## {title}", "", introduction, "") if introduction else ("", f"## {title}", "")


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """Yield a Markdown table."""
    yield line(head)
    yield line(["---"] * len(head))
    yield from map(line, rows)


def line(cells: Sequence[str]) -> str:
    """Return a row of a Markdown table."""
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def flat(groups: Iterable[Iterable[str]]) -> Iterator[str]:
    """Yield the lines of all groups."""
    for group in groups:
        yield from group


def generate() -> str:
    """Return the page of this project's tables and dialect."""
    return page(topics.TOPICS, topics.SERVICES, ET.parse(SIDESTEP_XML).getroot())


if __name__ == "__main__":
    print(generate(), end="")
