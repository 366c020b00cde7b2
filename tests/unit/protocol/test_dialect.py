"""The committed modules are the generator's output, and equal MAVLink's on the wire."""

import re
import xml.etree.ElementTree as ET

from plant.model.configuration import Body
from protocol import ring
from protocol.dialect import definitions
from protocol.dialect.definitions import (
    SIDESTEP_XML,
    Dialect,
    MessageType,
    SonarRing,
    read_dialect,
    upstream_definitions,
)
from protocol.dialect.generate import (
    CORE,
    FIRST_OWN_ID,
    OUTPUTS,
    ROOT,
    WIRE,
    commented,
    doc_lines,
    oracle,
)
from robot.core import ring as core_ring
from robot.core.parameters import DEFAULTS
from runtime.cli.packages import PACKAGES
from tests.support.each import each

DIALECT = read_dialect()
RINGS = ("protocol/ring.py", f"{CORE}/ring.py")


@each("path", OUTPUTS)
def test_the_committed_module_is_what_the_generator_writes(path: str) -> None:
    committed = (ROOT / path).read_text(encoding="utf-8")
    assert committed == OUTPUTS[path](DIALECT), f"{path} is stale: run `make generate`"


@each("message", DIALECT.messages)
def test_a_message_is_mavgens_on_the_wire(message: MessageType) -> None:
    theirs = oracle().mavlink_map[message.number]
    assert message.name == theirs.msgname
    assert message.crc_extra == theirs.crc_extra
    assert [field.name for field in message.fields] == theirs.fieldnames
    assert [field.kind for field in message.fields] == theirs.fieldtypes
    assert [field.name for field in message.wire_fields] == theirs.ordered_fieldnames
    assert [field.length for field in message.wire_fields] == theirs.array_lengths


def test_every_enum_has_mavgens_numbers_and_words() -> None:
    for name, enum in DIALECT.enums.items():
        theirs = oracle().enums[name]
        for entry in enum.entries:
            assert theirs[entry.value].name == f"{name}_{entry.name}"
            assert entry.text in {"", theirs[entry.value].description}


def test_own_enums_are_complete() -> None:
    for element in ET.parse(SIDESTEP_XML).getroot().iter("enum"):
        wanted = {entry.attrib["name"] for entry in element.iter("entry")}
        enum = DIALECT.enums[element.attrib["name"]]
        assert wanted <= {f"{enum.name}_{entry.name}" for entry in enum.entries}


def test_message_ids_are_unused_upstream() -> None:
    ours = {message.number for message in DIALECT.messages if message.number >= FIRST_OWN_ID}
    roots = [ET.parse(path).getroot() for path in upstream_definitions()]
    theirs = {int(element.attrib["id"]) for root in roots for element in root.iter("message")}
    assert len(ours) == 32
    assert not ours & theirs


def test_requested_upstream_definitions_exist() -> None:
    assert set(definitions.COMMON_MESSAGES) <= {message.name for message in DIALECT.messages}
    for name, members in definitions.COMMON_ENUMS.items():
        assert set(members) <= {entry.name for entry in DIALECT.enums[name].entries}
    for name, fields in definitions.OPTIONAL.items():
        message = next(message for message in DIALECT.messages if message.name == name)
        assert set(fields) <= {field.name for field in message.fields}


def test_no_sentence_has_a_number_that_the_code_uses() -> None:
    for entry in DIALECT.enums["SIDESTEP_REASON"].entries:
        assert not any(map(str.isdigit, entry.text)), entry.text
        assert entry.is_fixed <= (entry.timeout_ms > 0)


def test_no_upstream_text_is_copied() -> None:
    assert [path.name for path in SIDESTEP_XML.parent.glob("*.xml")] == ["sidestep.xml"]


def test_changed_description_changes_the_generated_code() -> None:
    changed = with_words(DIALECT, "in other words")
    stale = {path for path in OUTPUTS if OUTPUTS[path](changed) != OUTPUTS[path](DIALECT)}
    assert stale == set(OUTPUTS) - {f"{WIRE}/layouts.py", *RINGS}, "these have no words"


def test_limit_and_sentence_follow_the_attribute_in_the_xml() -> None:
    lost = DIALECT.enums["SIDESTEP_REASON"]
    entries = (
        entry._replace(timeout_ms=1700) if entry.timeout_ms else entry for entry in lost.entries
    )
    enums = DIALECT.enums | {lost.name: lost._replace(entries=tuple(entries))}
    messages = (
        message._replace(
            fields=tuple(f._replace(maximum="900" if f.maximum else "") for f in message.fields)
        )
        for message in DIALECT.messages
    )
    changed = DIALECT._replace(messages=tuple(messages), enums=enums)
    for path in (f"{WIRE}/limits.py", f"{CORE}/limits.py"):
        limits = OUTPUTS[path](changed)
        assert "\nTICKS_LOST_MS: Final = 1700  # no fresh wheel ticks\n" in limits
        assert "\nOPERATOR_LOST_MS: Final = 1700  # no operator heartbeat\n" in limits
    reasons = OUTPUTS[f"{WIRE}/reasons.py"](changed)
    assert '30: "no fresh wheel ticks for 1.7 s",' in reasons
    assert '38: "no operator heartbeat",' in reasons, "its time is a parameter of the robot"
    assert "\nMAX_TELEOP_TTL_MS: Final = 900\n" in OUTPUTS[f"{WIRE}/limits.py"](changed)
    assert "[ms, at most 900]" in OUTPUTS[f"{WIRE}/messages.py"](changed)


def test_the_ring_follows_the_attributes_in_the_xml() -> None:
    changed = DIALECT._replace(ring=SonarRing(-75.0, 75.0, 30.0, 150))
    for path in RINGS:
        text = OUTPUTS[path](changed)
        assert "\nRADIUS_M: Final = 0.15\nSONARS: Final = 6\n" in text
        assert "[(i - 2.5) * CONE" in text
    assert "\nALL_SONARS: Final = 63\nCONE_DEG: Final = 30.0\n" in OUTPUTS["protocol/ring.py"](
        changed
    )
    assert "\nCONE: Final = pi / 6.0\n" in OUTPUTS[f"{CORE}/ring.py"](changed)
    (ranges,) = (f for m in DIALECT.messages for f in m.fields if f.name == "range_mm")
    assert ranges.length == DIALECT.ring.sonars


def test_both_modules_of_the_ring_agree_to_the_last_bit() -> None:
    assert core_ring.BEARINGS == ring.BEARINGS_RAD
    assert (core_ring.SONARS, core_ring.CONE) == (ring.SONARS, ring.CONE_RAD)
    assert core_ring.RADIUS_M == ring.RADIUS_M == Body().radius_m == DEFAULTS.radius_m


SPELLED = re.compile(
    r"""radians\((22\.5|11\.25)\) | \bpi\ /\ (8|16)\b | \w\ -\ 3\.5\b | /\ \w+\ \+\ 3\.5\b
    | 0\.3926990 | 0\.1963495 | DEG(:\ Final)?\ =\ (22\.5|11\.25)\b | SONARS(:\ Final)?\ =\ 8\b
    | (?i:radius)\w*["']?(:\ (Final|float))?\ ?[=:]\ ?0\.12\b""",
    re.VERBOSE,
)
"""The number, the bearings and the cones of the sonars, and the radius of the robot, in code."""


def test_no_other_file_spells_the_numbers_of_the_ring() -> None:
    rooms = (*PACKAGES, "checks", "examples")
    paths = [path for room in rooms for path in (ROOT / room).rglob("*.py")]
    assert len(paths) > 300
    assert {
        str(path.relative_to(ROOT)) for path in paths if SPELLED.search(path.read_text("utf-8"))
    } == {*RINGS, f"{WIRE}/messages.py"}, "the docstring of a message says it, too"


@each(
    "code",
    [
        "CONE_RAD = radians(22.5)",
        "BETWEEN_DEG: Final = 22.5",
        "x = 2.0 * (pi / 16.0)",
        "x = [(i - 3.5) * cone_rad for i in range(n)]",
        "x = bearing_rad / STEP_RAD + 3.5",
        "BEAM_RAD = 0.39269908169872414",
        "SONARS: Final = 8",
        "DEFAULT_RADIUS_M: Final = 0.12",
        "    radius_m: float = 0.12",
        "Robot(radius_m=0.12)",
        'shape = {"radius": 0.12}',
    ],
)
def test_a_number_of_the_ring_is_recognised(code: str) -> None:
    assert SPELLED.search(code)


def with_words(dialect: Dialect, words: str) -> Dialect:
    """Return a dialect in which each own message and member has this description."""
    messages = (
        message._replace(text=words) if message.number >= FIRST_OWN_ID else message
        for message in dialect.messages
    )
    enums = {
        name: enum._replace(entries=tuple(entry._replace(text=words) for entry in enum.entries))
        for name, enum in dialect.enums.items()
    }
    return dialect._replace(messages=tuple(messages), enums=enums)


def test_a_docstring_is_a_summary_and_the_rest_of_it() -> None:
    assert doc_lines("One. Two.", "") == ['"""One.', "", "Two.", '"""']
    assert doc_lines("One.", "    ") == ['    """One."""']
    assert doc_lines("One.", "", ["More."]) == ['"""One.', "", "More.", '"""']


def test_long_comment_is_placed_above_its_line() -> None:
    assert commented("A = 1", "b", "") == ["A = 1  # b"]
    above = commented("A = 1", "b " * 60, "")
    assert above[-1] == "A = 1"
    assert all(line.startswith("# b") and len(line) <= 100 for line in above[:-1])
