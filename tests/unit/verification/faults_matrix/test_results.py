"""What a repetition must have shown, and results that outlive an interruption."""

from pathlib import Path

import pytest

from protocol.wire.reasons import Reason
from verification.faults_matrix.actions import Break, EmergencyStop
from verification.faults_matrix.results import Repetition, Results
from verification.faults_matrix.table import FAULTS, Fault, Must, Way, goes_on, stops

STOP = stops("a stop", EmergencyStop(), 0.25, Reason.SCAN_LOST)
DEATH = Fault(name="a death", act=Break(), must=Must.STAND, stands_s=0.2, unseen=True)
GO_ON = goes_on("a trifle", EmergencyStop())
SAFE = goes_on("a nuisance", EmergencyStop(), Must.BE_SAFE)
IN_TIME = goes_on("a slow disk", EmergencyStop(), Must.KEEP_TIME)
BLIND = goes_on("a lie", EmergencyStop(), Must.TOUCH_AT_MOST)


def of(fault: Fault, **shown: object) -> list[str]:
    return Repetition(fault=fault.name, way="wall", number=0, **shown).misses(fault)  # type: ignore[arg-type]


def test_a_robot_that_stops_in_time_and_says_why_does_what_it_must() -> None:
    assert of(STOP, known_s=0.35, stood_s=0.75, reason="SCAN_LOST") == []


def test_what_is_late_or_never_comes_is_told_in_milliseconds() -> None:
    assert of(STOP, known_s=0.36, stood_s=0.75, reason="SCAN_LOST") == [
        "known after 360 ms, not 350"
    ]
    assert of(STOP, known_s=0.3, reason="SCAN_LOST") == ["never stood"]
    assert of(DEATH, stood_s=0.21) == ["stood after 210 ms, not 200"]


def test_another_reason_or_none_is_wrong() -> None:
    assert of(STOP, known_s=0.3, stood_s=0.6, reason="BUMPER") == ["called it BUMPER"]
    assert of(STOP, known_s=0.3, stood_s=0.6) == ["called it nothing"]


def test_who_has_stood_must_not_move_again() -> None:
    assert of(DEATH, stood_s=0.1, moved_again=True) == ["moved again"]


def test_who_cannot_be_heard_is_judged_by_its_wheels() -> None:
    assert of(DEATH, stood_s=0.1) == []


def test_going_on_is_arriving_without_a_contact() -> None:
    assert of(GO_ON, reached=True) == []
    assert of(GO_ON, reached=True, contacts=2) == ["2 contacts"]
    assert of(GO_ON, reason="TICKS_LOST") == ["did not arrive (TICKS_LOST)"]


def test_being_safe_is_arriving_or_stopping_with_a_reason() -> None:
    assert of(SAFE, reached=True) == []
    assert of(SAFE, reason="TICKS_LOST") == []
    assert of(SAFE) == ["neither arrived nor stopped with a reason"]
    assert of(SAFE, reached=True, contacts=1) == ["1 contacts"]


def test_keeping_time_is_arriving_without_a_missed_tick() -> None:
    assert of(IN_TIME, reached=True, missed_ticks=0) == []
    assert of(IN_TIME, reached=True, missed_ticks=3) == ["missed 3 ticks"]
    assert of(IN_TIME, missed_ticks=0) == ["did not arrive (late)"]


def test_what_cannot_be_known_may_end_in_a_contact_that_stops_it() -> None:
    assert of(BLIND, reason="BUMPER", contacts=1, touched_s=0.4) == []
    assert of(BLIND, reason="BUMPER", contacts=1, touched_s=0.6) == [
        "drove on for 0.60 s after a contact"
    ]


def test_a_repetition_that_broke_down_is_a_miss() -> None:
    assert of(GO_ON, reached=True, trouble="RuntimeError: no router") == ["RuntimeError: no router"]


def test_an_interrupted_run_goes_on_from_what_is_kept(tmp_path: Path) -> None:
    file = tmp_path / "kept.jsonl"
    first = Repetition(fault="a stop", way="wall", number=3, stood_s=0.5, reason="BUMPER")
    Results.kept_in(file).add(first)
    with file.open("a") as torn:
        torn.write('{"fault": "a st')
    found = Results.kept_in(file)
    assert found.of(STOP, Way.WALL) == [first]
    assert found.has("a stop", Way.WALL, 3)
    assert not found.has("a stop", Way.LOCKSTEP, 3)


def test_what_is_measured_again_counts_instead(tmp_path: Path) -> None:
    results = Results(None)
    for stood_s in (0.5, 0.1):
        results.add(Repetition(fault="a death", way="wall", number=0, stood_s=stood_s))
    assert [one.stood_s for one in results.of(DEATH, Way.WALL)] == [0.1]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_each_row_has_a_limit_or_must_go_on(fault: Fault) -> None:
    stopping = fault.must in (Must.STOP, Must.STAND, Must.SAY)
    assert stopping == bool(fault.limit)
    assert fault.ways


def test_each_row_has_a_name_of_its_own() -> None:
    assert len({fault.name for fault in FAULTS}) == len(FAULTS)
