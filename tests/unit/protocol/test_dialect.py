"""The committed modules are the generator's output, and equal MAVLink's on the wire."""

import xml.etree.ElementTree as ET

from protocol.dialect import definitions
from protocol.dialect.definitions import (
    SIDESTEP_XML,
    Dialect,
    MessageType,
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
from tests.support.each import each

DIALECT = read_dialect()


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
    assert len(ours) == 31
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
    assert stale == set(OUTPUTS) - {f"{WIRE}/layouts.py"}


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
    changed = Dialect(tuple(messages), enums)
    for path in (f"{WIRE}/limits.py", f"{CORE}/limits.py"):
        limits = OUTPUTS[path](changed)
        assert "\nTICKS_LOST_MS: Final = 1700  # no fresh wheel ticks\n" in limits
        assert "\nOPERATOR_LOST_MS: Final = 1700  # no operator heartbeat\n" in limits
    reasons = OUTPUTS[f"{WIRE}/reasons.py"](changed)
    assert '30: "no fresh wheel ticks for 1.7 s",' in reasons
    assert '38: "no operator heartbeat",' in reasons, "its time is a parameter of the robot"
    assert "\nMAX_TELEOP_TTL_MS: Final = 900\n" in OUTPUTS[f"{WIRE}/limits.py"](changed)
    assert "[ms, at most 900]" in OUTPUTS[f"{WIRE}/messages.py"](changed)


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
    return Dialect(tuple(messages), enums)


def test_a_docstring_is_a_summary_and_the_rest_of_it() -> None:
    assert doc_lines("One. Two.", "") == ['"""One.', "", "Two.", '"""']
    assert doc_lines("One.", "    ") == ['    """One."""']
    assert doc_lines("One.", "", ["More."]) == ['"""One.', "", "More.", '"""']


def test_long_comment_is_placed_above_its_line() -> None:
    assert commented("A = 1", "b", "") == ["A = 1  # b"]
    above = commented("A = 1", "b " * 60, "")
    assert above[-1] == "A = 1"
    assert all(line.startswith("# b") and len(line) <= 100 for line in above[:-1])
