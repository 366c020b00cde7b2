"""Typed messages: the fields of the XML, immutable, and checked on construction."""

from typing import Any

import pytest
from hypothesis import given

from protocol.dialect.generate import oracle
from protocol.wire.message import LAYOUT, Message, check
from protocol.wire.messages import (
    MESSAGES,
    CycleReport,
    LeaseRequest,
    LeaseStatus,
    ParamRequestRead,
    ParamSet,
    ParamValue,
    RunScore,
    SonarScan,
    Statustext,
)
from runtime.errors import LocalError
from tests.support.each import each
from tests.support.protocol.made_up import any_message

SCAN = SonarScan(time_ns=0, seq=0, range_mm=(0,) * 8, ping_age_us=(0,) * 8, valid=0, echo=0)


def test_there_is_a_class_for_every_layout() -> None:
    assert {cls.__name__ for cls in MESSAGES} == set(LAYOUT)


@each("cls", MESSAGES)
def test_fields_are_those_of_the_xml_in_its_order(cls: type[Message]) -> None:
    theirs = oracle().mavlink_map[LAYOUT[cls.__name__].number]
    assert list(cls.__struct_fields__) == theirs.fieldnames


def test_a_message_cannot_be_changed() -> None:
    with pytest.raises(AttributeError):
        SCAN.seq = 1  # type: ignore[misc]


def test_fields_have_to_be_named() -> None:
    with pytest.raises(TypeError):
        SonarScan(0, 0, (0,) * 8, (0,) * 8, 0, 0)  # type: ignore[call-arg]


@each("length", [0, 7, 9])
def test_an_array_of_the_wrong_length_is_refused_when_made(length: int) -> None:
    with pytest.raises(LocalError, match=r"SonarScan\.range_mm = .*: must be 8 numbers"):
        SonarScan(time_ns=0, seq=0, range_mm=(0,) * length, ping_age_us=(0,) * 8, valid=0, echo=0)


def test_every_array_is_checked_when_made() -> None:
    zeros = dict.fromkeys(CycleReport.__struct_fields__, 0)
    with pytest.raises(LocalError, match="stage_us"):
        CycleReport(**{**zeros, "stage_us": (1, 2)})  # type: ignore[arg-type]
    zeros = dict.fromkeys(RunScore.__struct_fields__, 0)
    with pytest.raises(LocalError, match="digest"):
        RunScore(**{**zeros, "digest": (1,) * 31})  # type: ignore[arg-type]


@each(
    ("text", "limit"),
    [("x" * 51, "at most 50 bytes"), ("\xe9" * 26, "at most 50 bytes"), ("a\0b", "NUL")],
)
def test_a_text_that_does_not_fit_is_refused_when_made(text: str, limit: str) -> None:
    with pytest.raises(LocalError, match=limit):
        Statustext(severity=6, text=text)


def test_a_parameters_name_has_sixteen_bytes() -> None:
    sixteen = "p" * 16
    check(ParamSet(param_id=sixteen, param_value=1.0, param_type=9))
    for make in (
        lambda name: ParamSet(param_id=name, param_value=1.0, param_type=9),
        lambda name: ParamRequestRead(param_id=name, param_index=-1),
        lambda name: ParamValue(
            param_id=name, param_value=1.0, param_type=9, param_count=1, param_index=0
        ),
    ):
        with pytest.raises(LocalError, match=r"param_id = .*: must be at most 16 bytes"):
            make(sixteen + "q")


def test_names_in_a_lease_have_their_sizes() -> None:
    LeaseRequest(request_id=1, action=0, name="n" * 16)
    with pytest.raises(LocalError, match=r"name = .*: must be at most 16 bytes"):
        LeaseRequest(request_id=1, action=0, name="n" * 17)
    for holder, name in (("h" * 57, ""), ("", "n" * 17)):
        with pytest.raises(LocalError, match=r"must be at most"):
            LeaseStatus(time_ns=1, lapses_ms=0, held=1, holder=holder, name=name)


@each(
    ("change", "words"),
    [
        ({"severity": 256}, "severity = 256: must be an integer from 0 to 255"),
        ({"severity": "6"}, "severity = '6': must be an integer"),
        ({"text": "\ud800"}, "text = .*: must be valid Unicode"),
    ],
)
def test_check_names_what_construction_accepts(change: dict[str, Any], words: str) -> None:
    with pytest.raises(LocalError, match=words):
        check(Statustext(**{"severity": 6, "text": "", **change}))


def test_value_that_is_not_a_number_is_named() -> None:
    with pytest.raises(LocalError, match=r"param_value = None: must be a number"):
        check(ParamSet(param_id="p", param_value=None, param_type=9))  # type: ignore[arg-type]


def test_ranges_can_be_checked_without_a_wire() -> None:
    with pytest.raises(LocalError, match=r"SonarScan\.valid = 256: .* from 0 to 255"):
        check(SonarScan(**{**fields_of(SCAN), "valid": 256}))  # type: ignore[arg-type]


@given(any_message)
def test_every_wire_value_passes_the_check(message: Message) -> None:
    check(message)


def fields_of(message: Message) -> dict[str, object]:
    return {name: getattr(message, name) for name in message.__struct_fields__}
