"""Makes the tables of the reference from the code, so that they cannot become outdated.

As a program it prints docs/reference/protocol.md, made of topic tables and dialect:
`make generate-docs`. The permissions of each certificate are derived from the rules given to Zenoh.
"""

import argparse
import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, fields
from functools import cache
from itertools import chain
from math import degrees, inf
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NamedTuple
from unittest.mock import patch

import zenoh

from ground.app.input.keymap import KEYS, Layer
from ground.client.outcomes import answer_row
from ground.missions.mission import Circle, Home, Waypoint
from plant.corpus.generate import EVERY_FAMILY
from plant.model.configuration import LEVELS, Body, Fault, Noise
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
from protocol.outcome import OUTCOMES, REPLACED, RunOutcome
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
from protocol.wire.reasons import REASON_TEXTS, Reason
from robot.parameter_table import SPECS
from runtime.cli.parsers import parser_of, program_parsers
from runtime.cli.verb import MORE, REC, Verb
from runtime.cli.verb import RUN as RUN_SECTION
from runtime.cli.verb_table import VERBS, command_of
from runtime.units import NS_PER_MS
from study.runner.store import SCHEMA

WIDTH: Final = 88
TITLES: Final = {RUN_SECTION: "Run one process", REC: "Recordings", MORE: "Further groups"}
"""Headings of sections of verbs, where they differ from the name of the section."""
GROUPS: Final = {
    range(1, 30): "refusals",
    range(30, 60): "failsafes",
    range(60, 80): "ends of a goal",
    range(80, 100): "guard",
    range(100, 120): "further refusals",
    range(120, 140): "notes on an accepted request",
}


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(
        "| " + " | ".join(str(cell).replace("|", "\\|").replace("\n", " ") for cell in line) + " |"
        for line in lines
    )


def command_line() -> str:
    """Return a section for each verb: its summary, usage, arguments and options."""
    parts, section = [], ""
    with patch.dict(os.environ):
        os.environ.pop("XDG_STATE_HOME", None)  # helps show the usual folder, not that of this user
        for word, verb in VERBS.items():
            if verb.section != section:
                section = verb.section
                parts.append(f"## {TITLES.get(section, section.capitalize())}")
            parts += verb_section(word, verb)
    return "\n\n".join(parts)


def verb_section(word: str, verb: Verb) -> Iterator[str]:
    """Yield heading, summary, usage and tables of a verb and of the verbs below it."""
    yield f"### {command_of(word)}"
    yield f"{verb.summary[:1].upper()}{verb.summary[1:]}."
    yield from parser_parts(parser_of(word))
    for name, parser in program_parsers(word).items():
        yield f"#### {command_of(word)} {name}"
        yield f"{verb.subcommands[name].summary.capitalize()}."
        yield from parser_parts(parser)


def parser_parts(parser: argparse.ArgumentParser) -> Iterator[str]:
    """Yield usage, arguments and sub-commands of a parser."""
    parser.formatter_class = wide
    yield f"```text\n{parser.format_usage().removeprefix('usage: ').strip()}\n```"
    rows, below = [], []
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            helps = {one.dest: one.help or "" for one in action._choices_actions}
            below += [(name, helps.get(name, ""), one) for name, one in action.choices.items()]
        elif action.help != argparse.SUPPRESS and not isinstance(action, argparse._HelpAction):
            rows.append((f"`{name_of(action)}`", help_of(parser, action)))
    if rows:
        yield table(("argument", "meaning"), rows)
    if parser.epilog:
        yield f"```text\n{parser.epilog.strip()}\n```"
    for name, summary, one in below:
        yield f"#### {parser.prog.removeprefix('sidestep ')} {name}"
        if summary:
            yield f"{summary[:1].upper()}{summary[1:]}."
        yield from parser_parts(one)


def wide(prog: str) -> argparse.HelpFormatter:
    """Return a formatter whose width does not depend on the terminal."""
    return argparse.HelpFormatter(prog, width=WIDTH)


def name_of(action: argparse.Action) -> str:
    """Return how an argument is written: its flags and the name of its value."""
    value = action.metavar or (
        "{" + ",".join(map(str, action.choices)) + "}" if action.choices else action.dest.upper()
    )
    words = " ".join(value) if isinstance(value, tuple) else value
    if not action.option_strings:
        return words if action.nargs not in ("?", "*") else f"[{words}]"
    takes_value = action.nargs != 0
    return ", ".join(action.option_strings) + (f" {words}" if takes_value else "")


def help_of(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    """Return the help of an argument with its values filled in; the home folder is `~`."""
    text = parser._get_formatter()._expand_help(action) if action.help else ""
    return text.replace(str(Path.home()), "~")


def parameters() -> str:
    """Return the table of the robot's parameters."""
    head = ("name", "default", "unit", "from", "to", "safety", "meaning")
    return table(
        head,
        (
            (
                f"`{one.name}`",
                f"{one.default:g}",
                one.unit,
                f"{one.minimum:g}",
                f"{one.maximum:g}",
                one.safer,
                one.doc,
            )
            for one in SPECS.values()
        ),
    )


def reasons() -> str:
    """Return a table of reasons for each group of codes."""
    parts = []
    for codes, name in GROUPS.items():
        rows = [
            (code, f"`{Reason(code).name}`", text)
            for code, text in REASON_TEXTS.items()
            if code in codes
        ]
        parts += [f"## {name.capitalize()}", table(("code", "name", "text"), rows)]
    return "\n\n".join(parts)


def keys() -> str:
    """Return a table of keys for each place where they count."""
    parts = []
    for layer in Layer:
        rows = [
            (" ".join(f"`{word}`" for word in key.keys), key.description, f"`{key.id}`")
            for key in KEYS
            if key.layer is layer
        ]
        if rows:
            parts += [f"## {layer.value.capitalize()}", table(("keys", "action", "id"), rows)]
    return "\n\n".join(parts)


def outcome_keys() -> str:
    """Return the keys that `up`, `trial` and `study` print with --json."""
    rows = [
        (f"`{one.name}`", f"`{getattr(one.type, '__name__', one.type)}`")
        for one in fields(RunOutcome)
    ]
    words = ", ".join(f"`{one}`" for one in OUTCOMES)
    keys = table(("key", "type"), rows)
    return f"{keys}\n\n`outcome` is one of {words}; with `up` also `{REPLACED}`."


def answer_keys() -> str:
    """Return the keys of the answer of a robot to a command."""
    row = answer_row("hold", "r1", Reason.NONE, 2_000_000)
    return table(("key", "example"), ((f"`{key}`", f"`{value}`") for key, value in row.items()))


def study_rows() -> str:
    """Return the columns of a study's results."""
    return table(
        ("column", "type", "may be missing"),
        ((f"`{one.name}`", one.type, "yes" if one.nullable else "") for one in SCHEMA),
    )


def settings(kind: Any) -> str:
    """Return the keys of a table in a file that fills a dataclass: name and default."""
    rows = []
    for one in fields(kind):
        is_angle = one.name.endswith("_rad")
        name = one.name.removesuffix("_rad") + "_deg" if is_angle else one.name
        value = one.default
        if value is MISSING:
            shown = "required"
        elif value is None or value == inf:
            shown = "none"
        else:
            shown = f"`{degrees(value) if is_angle else value}`"
        rows.append((f"`{name}`", shown))
    return table(("key", "default"), rows)


def noise_levels() -> str:
    """Return the values of each level of noise."""
    names = [one.name for one in fields(Noise)]
    rows = [
        (f"`{name}`", *(f"{getattr(LEVELS[level], name):g}" for level in LEVELS)) for name in names
    ]
    return table(("value", *LEVELS), rows)


def families() -> str:
    """Return the names of the families of generated worlds."""
    return ", ".join(f"`{name}`" for name in EVERY_FAMILY) + "."


GENERATORS: Final[Mapping[str, Callable[[], str]]] = MappingProxyType(
    {
        "answer-keys": answer_keys,
        "circle": lambda: settings(Circle),
        "command-line": command_line,
        "families": families,
        "fault": lambda: settings(Fault),
        "home": lambda: settings(Home),
        "keys": keys,
        "noise-levels": noise_levels,
        "outcome-keys": outcome_keys,
        "parameters": parameters,
        "reasons": reasons,
        "robot-body": lambda: settings(Body),
        "study-rows": study_rows,
        "waypoint": lambda: settings(Waypoint),
    }
)
"""A page asks for one of these with a comment: `<!-- generated: NAME -->`."""


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
        table(stream_head, map(stream_row, streams)),
        *section("Services", "Every query is answered; a refusal contains its reason."),
        table(service_head, map(service_row, services)),
        *section("Permissions", ACCESS),
        table(head(), rows()),
        "",
        *ACCESS_KEYS.splitlines(),
        "",
        table(access_head, access_rows()),
        *section("Messages of this project"),
        *chain.from_iterable(map(message_lines, dialect.iterfind("messages/message"))),
        *section("Messages of MAVLink's common dialect in use"),
        *common_lines(dialect),
        *section("Enumerations"),
        *chain.from_iterable(map(enum_lines, dialect.iterfind("enums/enum"))),
    ]
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines)).rstrip() + "\n"


def access_rows() -> Iterator[Sequence[str]]:
    """Yield the grants of each certificate, without the robot name that each key begins with."""
    for name, grant in grants((SAMPLE_ROBOT,), (SAMPLE_OPERATOR,)).items():
        lists = (grant.puts, grant.subscribes, grant.fetches, grant.asks, grant.answers)
        certificate = name.replace(SAMPLE_ROBOT, "NAME").replace(SAMPLE_OPERATOR, "NAME")
        cells = (key_families(paths).replace(SAMPLE_OPERATOR, "NAME") for paths in lists)
        yield f"`{certificate}`", *cells


def key_families(paths: Iterable[str]) -> str:
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
    yield table(("field", "type", "unit", "meaning"), map(field_row, message.iter("field")))
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
    yield table(
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
    yield table(("value", "name", "meaning"), rows)
    yield ""


def words(element: ET.Element) -> str:
    """Return the description of an element."""
    return (element.findtext("description") or "").strip()


def section(title: str, introduction: str = "") -> tuple[str, ...]:
    """Return a heading and an optional introduction."""
    return ("", f"## {title}", "", introduction, "") if introduction else ("", f"## {title}", "")


def generate() -> str:
    """Return the page of this project's tables and dialect."""
    return page(topics.TOPICS, topics.SERVICES, ET.parse(SIDESTEP_XML).getroot())


if __name__ == "__main__":
    print(generate(), end="")
