"""The committed generated files are what the generator writes today, and upstream's on the wire."""

from pathlib import Path
from typing import Any

import pytest

from protocol.dialect import generate, generated
from protocol.dialect.generate import COMMON_MESSAGES, HERE, generated_text, loaded
from protocol.dialect.layout_text import layout_text


@pytest.fixture(scope="module")
def text() -> str:
    return generated_text()


@pytest.fixture(scope="module")
def upstream(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """All of pymavlink's common dialect, generated from its own files."""
    output = tmp_path_factory.mktemp("upstream") / "common.py"
    generate.run_mavgen(generate.upstream_definitions()[0], output)
    return loaded(output.read_text(encoding="utf-8"))


def test_the_committed_module_is_what_mavgen_writes(text: str) -> None:
    assert (HERE / "generated.py").read_text(encoding="utf-8") == text


def test_the_committed_layouts_are_those_of_the_module(text: str) -> None:
    assert (HERE / "layouts.py").read_text(encoding="utf-8") == layout_text(loaded(text))


def test_generating_twice_gives_the_same_bytes(text: str) -> None:
    assert generated_text() == text


@pytest.mark.parametrize("name", COMMON_MESSAGES)
def test_a_common_message_is_upstreams_on_the_wire(name: str, upstream: Any) -> None:
    ours = next(m for m in generated.mavlink_map.values() if m.msgname == name)
    theirs = upstream.mavlink_map[ours.id]
    for fact in ("msgname", "fieldnames", "ordered_fieldnames", "fieldtypes", "array_lengths"):
        assert getattr(ours, fact) == getattr(theirs, fact)
    assert (ours.crc_extra, ours.unpacker.format) == (theirs.crc_extra, theirs.unpacker.format)


def test_our_ids_are_used_by_nobody_upstream(upstream: Any) -> None:
    ours = {number for number in generated.mavlink_map if number >= 54_100}
    assert len(ours) == 18
    assert not ours & set(upstream.mavlink_map)


def test_no_text_of_upstreams_xml_is_kept_beside_ours() -> None:
    assert [path.name for path in Path(HERE).glob("*.xml")] == ["sidestep.xml"]
