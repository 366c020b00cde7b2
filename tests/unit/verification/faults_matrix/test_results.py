"""The verdict on a repetition, and results that survive an interruption."""

from pathlib import Path

from checks.faults.cases import FAULTS, FaultCase, Must, PlainAct, Way, goes_on, stops
from checks.faults.results import Repetition, Results
from protocol.wire.reasons import Reason
from tests.support.each import each

STOP = stops("a stop", PlainAct.EMERGENCY_STOP, 0.25, Reason.SCAN_LOST)
DEATH = FaultCase(
    name="a death", act=PlainAct.RAISE_IN_CORE, must=Must.STAND, stands_s=0.2, unseen=True
)
GO_ON = goes_on("a trifle", PlainAct.EMERGENCY_STOP)
SAFE = goes_on("a nuisance", PlainAct.EMERGENCY_STOP, Must.BE_SAFE)
IN_TIME = goes_on("a slow disk", PlainAct.EMERGENCY_STOP, Must.KEEP_TIME)
BLIND = goes_on("a lie", PlainAct.EMERGENCY_STOP, Must.TOUCH_AT_MOST)


def of(fault: FaultCase, **shown: object) -> list[str]:
    return Repetition(fault=fault.name, way="wall", number=0, **shown).misses(fault)  # type: ignore[arg-type]


def test_stop_in_time_with_the_reason_passes() -> None:
    assert of(STOP, known_s=0.35, stood_s=0.75, reason="SCAN_LOST") == []


def test_late_or_missing_stop_is_reported_in_milliseconds() -> None:
    assert of(STOP, known_s=0.36, stood_s=0.75, reason="SCAN_LOST") == [
        "known after 360 ms, not 350"
    ]
    assert of(STOP, known_s=0.3, reason="SCAN_LOST") == ["never stopped"]
    assert of(DEATH, stood_s=0.21) == ["stopped after 210 ms, not 200"]


def test_other_reason_or_none_is_a_miss() -> None:
    assert of(STOP, known_s=0.3, stood_s=0.6, reason="BUMPER") == ["reported BUMPER"]
    assert of(STOP, known_s=0.3, stood_s=0.6) == ["reported no reason"]


def test_robot_must_not_move_after_it_stopped() -> None:
    assert of(DEATH, stood_s=0.1, moved_again=True) == ["moved again"]


def test_unreachable_robot_is_judged_by_its_wheels() -> None:
    assert of(DEATH, stood_s=0.1) == []


def test_driving_on_means_arriving_without_contact() -> None:
    assert of(GO_ON, reached=True) == []
    assert of(GO_ON, reached=True, contacts=2) == ["2 contacts"]
    assert of(GO_ON, reason="TICKS_LOST") == ["did not arrive (TICKS_LOST)"]


def test_safe_means_arriving_or_stopping_with_a_reason() -> None:
    assert of(SAFE, reached=True) == []
    assert of(SAFE, reason="TICKS_LOST") == []
    assert of(SAFE) == ["neither arrived nor stopped with a reason"]
    assert of(SAFE, reached=True, contacts=1) == ["1 contacts"]


def test_keeping_time_means_no_missed_tick() -> None:
    assert of(IN_TIME, reached=True, missed_ticks=0) == []
    assert of(IN_TIME, reached=True, missed_ticks=3) == ["missed 3 ticks"]
    assert of(IN_TIME, missed_ticks=0) == ["did not arrive (late)"]


def test_undetectable_fault_may_end_in_a_short_contact() -> None:
    assert of(BLIND, reason="BUMPER", contacts=1, touched_s=0.4) == []
    assert of(BLIND, reason="BUMPER", contacts=1, touched_s=0.6) == [
        "drove on for 0.60 s after a contact"
    ]


def test_failed_repetition_is_a_miss() -> None:
    assert of(GO_ON, reached=True, trouble="RuntimeError: no router") == ["RuntimeError: no router"]


def test_interrupted_run_continues_from_saved_results(tmp_path: Path) -> None:
    file = tmp_path / "kept.jsonl"
    first = Repetition(fault="a stop", way="wall", number=3, stood_s=0.5, reason="BUMPER")
    Results.kept_in(file).add(first)
    with file.open("a") as torn:
        torn.write('{"fault": "a st')
    found = Results.kept_in(file)
    assert found.of(STOP, Way.WALL) == [first]
    assert found.has("a stop", Way.WALL, 3)
    assert not found.has("a stop", Way.LOCKSTEP, 3)


def test_repeated_measurement_replaces_the_old_one(tmp_path: Path) -> None:
    results = Results(None)
    for stood_s in (0.5, 0.1):
        results.add(Repetition(fault="a death", way="wall", number=0, stood_s=stood_s))
    assert [one.stood_s for one in results.of(DEATH, Way.WALL)] == [0.1]


@each("fault", FAULTS)
def test_only_stopping_rows_have_a_limit(fault: FaultCase) -> None:
    assert fault.must_stop == bool(fault.limit)
    assert fault.ways


def test_row_names_are_unique() -> None:
    assert len({fault.name for fault in FAULTS}) == len(FAULTS)
