"""The fault matrix: verdicts, page, logs, intruders, and power cuts in every order of writes."""

from collections.abc import Callable, Iterator
from math import isinf, isnan
from pathlib import Path
from typing import Any

import pytest

from checks.faults import restarts
from checks.faults.bus_observer import READ, RECEIVED, extremes, extremes_of, turns
from checks.faults.cases import (
    FAULTS,
    FaultCase,
    Must,
    PlainAct,
    Repetition,
    Results,
    Way,
    goes_on,
    page,
    stops,
)
from checks.faults.restarts import restarted
from checks.faults.wall_time import lost_from, missing
from checks.harness.reordering_disk import ReorderingDisk, State
from ground.recording.log_reader import record_bytes
from protocol.topics import STOP as TOPICS_STOP
from protocol.wire.codec import Encoder, decode
from protocol.wire.enums import Command, MissionType, Severity
from protocol.wire.message import LAYOUT
from protocol.wire.messages import (
    CommandRequest,
    MissionClearAll,
    MissionItemInt,
    ParamSet,
    ParamValue,
    SonarScan,
    Statustext,
    Teleop,
    WheelTicks,
)
from protocol.wire.reasons import Reason
from robot.core.parameters import DEFAULTS
from robot.emergency_stop import emergency_stop
from robot.file_writer import Directory
from robot.mission import MissionStore, text_of
from robot.storage import Store
from runtime import files
from tests.support.each import each
from tests.support.robots import Desk, circle, line, upload

UTC_2026_US = 1_795_000_000_000_000


@each(
    ("numbers", "gap"),
    [
        ([], 0),
        ([7], 0),
        ([254, 255, 0, 1], 0),
        ([1, 2, 5], 2),
        ([250, 4], 9),
        ([1, 3, 2, 4], 0),
        ([1, 1, 2], 0),
        ([1, 4, 2], 1),
        ([*range(256), *range(10)], 0),
    ],
)
def test_gaps_are_counted_across_wrap_and_reordering(numbers: list[int], gap: int) -> None:
    assert missing(numbers) == gap


def test_samples_and_events_are_counted_except_restarted_keys(tmp_path: Path) -> None:
    plant, robot = Encoder(1, 25), Encoder(1, 1)
    ticks = [
        plant.encode(WheelTicks(time_ns=n, seq=n, left=0, right=0, bumper=0, expired=0))
        for n in range(10)
    ]
    texts = [robot.encode(Statustext(severity=Severity.INFO, text=f"{n}")) for n in range(4)]
    kept = [*ticks[:3], *ticks[6:], texts[0], texts[3]]
    path = tmp_path / "20261121T000000Z-r1.tlog"
    path.write_bytes(
        b"".join(record_bytes(UTC_2026_US + at, frame) for at, frame in enumerate(kept))
    )
    lost = lost_from(path)
    assert (lost.logged, lost.samples, lost.events) == (9, 3, 2)
    assert lost.last_ns == (UTC_2026_US + 8) * 1000
    assert lost_from(path, restarted=("sense/",)).samples == 0


HOME = Path("/state/of/r1")
Held = tuple[float, str, str, bool]
"""A parameter, the fence, the mission and whether it is stopped: what a restart finds."""


class ChangingOperator:
    """Changes one setting after the other, and keeps the state that must survive."""

    def __init__(self) -> None:
        self.desk = Desk(Store(HOME))
        self.desk.vehicle.restore()
        self.desk.arm()
        self.held: Held = (DEFAULTS.d_obs_m, text_of(()), text_of(()), False)

    def put(self, items: list[MissionItemInt]) -> None:
        assert upload(self.desk, items).reason == Reason.NONE
        self._holds(items[0].mission_type, text_of(tuple(items)))

    def clear(self, kind: MissionType) -> None:
        answer = self.desk.vehicle.receive(MissionClearAll(mission_type=kind), 0)
        assert getattr(answer, "reason", None) == Reason.NONE
        self._holds(kind, text_of(()))

    def set(self, value: float) -> None:
        request = ParamSet(param_id="d_obs_m", param_value=value, param_type=9)
        assert isinstance(self.desk.vehicle.receive(request, 0), ParamValue)
        self.held = value, *self.held[1:]

    def _holds(self, kind: int, items: str) -> None:
        value, fence, mission, stopped = self.held
        fence = items if kind == MissionType.FENCE else fence
        mission = items if kind == MissionType.MISSION else mission
        self.held = value, fence, mission, stopped

    def stop(self) -> None:
        self.desk.vehicle.receive(emergency_stop(0), 0)
        self.held = *self.held[:3], True

    def release(self) -> None:
        assert self.desk.command(Command.SIDESTEP_CLEAR_EMERGENCY_STOP) == Reason.NONE
        self.held = *self.held[:3], False


STEPS: tuple[Callable[[ChangingOperator], None], ...] = (
    lambda owner: owner.put(circle(0.0, 0.0, 3.0)),
    lambda owner: owner.set(0.45),
    lambda owner: owner.put(line(2)),
    lambda owner: owner.stop(),
    lambda owner: owner.release(),
    lambda owner: owner.put(circle(0.0, 0.0, 5.0)),
    lambda owner: owner.stop(),
    lambda owner: owner.clear(MissionType.FENCE),
    lambda owner: owner.set(0.5),
    lambda owner: owner.put(circle(0.0, 0.0, 4.0)),
    lambda owner: owner.clear(MissionType.MISSION),
)


def found(state: State, folder: Path) -> Held:
    """Return the state of a robot that starts after this cut."""
    with restarted(state, folder):
        home = folder / str(HOME).removeprefix("/")
        kept = MissionStore(Directory(home))
        store = Store(home)
        params, warnings = store.load(DEFAULTS)
        assert warnings == []
        fence, mission = kept.found(MissionType.FENCE), kept.found(MissionType.MISSION)
        return params.d_obs_m, text_of(fence), text_of(mission), store.stop.found()


def outcomes(
    disk: ReorderingDisk, folder: Path
) -> Iterator[tuple[Held, Held, set[Held], set[Held]]]:
    """Yield for each step the states before and after it, and those of cuts during and after."""
    owner = ChangingOperator()
    known: dict[State, Held] = {}

    def all_found(states: frozenset[State]) -> set[Held]:
        for state in states - known.keys():
            known[state] = found(state, folder / str(len(known)))
        return {known[state] for state in states}

    for step in STEPS:
        before, begun = owner.held, len(disk.cuts)
        step(owner)
        during = {one for states in disk.cuts[begun:] for one in all_found(states)}
        yield before, owner.held, during, all_found(disk.cuts[-1])


def test_every_cut_keeps_acknowledged_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = ReorderingDisk()
    monkeypatch.setattr(files, "os", disk)
    for before, after, during, at_the_end in outcomes(disk, tmp_path):
        assert during == {before, after}
        assert at_the_end == {after}


class UnsyncedRenames(ReorderingDisk):
    """A disk as of a robot that does not synchronise directories."""

    def fsync(self, handle: int) -> None:
        if not self.isdir_open(handle):
            super().fsync(handle)


def test_unsynchronised_directory_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disk = UnsyncedRenames()
    monkeypatch.setattr(files, "os", disk)
    assert any(at_the_end != {after} for _, after, _, at_the_end in outcomes(disk, tmp_path))


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


def page_of(*repetitions: Repetition, before: str = "") -> str:
    results = Results(None)
    for one in repetitions:
        results.add(one)
    return page(results, {"cores": 2}, before)


def killed(number: int, stood_s: float, **more: Any) -> Repetition:
    return Repetition(
        fault="robot killed", way="wall", number=number, stood_s=stood_s, distance_m=0.045, **more
    )


def test_every_fault_has_a_row() -> None:
    text = page_of()
    for fault in FAULTS:
        assert f"| {fault.name.replace('|', chr(92) + '|')} |" in text


def test_page_states_that_no_row_missed() -> None:
    assert "## Rows that miss their limit\n\nNone.\n" in page_of(killed(0, 0.15))


def test_missing_row_is_listed_first_with_count_and_excess() -> None:
    text = page_of(killed(0, 0.15), killed(1, 0.25))
    named = "- **robot killed** in wall, 1 of 2: stopped after 250 ms, not 200"
    assert text.index(named) < text.index("## Processes")
    assert "**1 of 2 missed**" in text


def test_cell_has_median_worst_and_path() -> None:
    row = next(
        line
        for line in page_of(*map(killed, range(3), (0.1, 0.12, 0.18))).splitlines()
        if line.startswith("| robot killed")
    )
    assert "120 / 180 (3)" in row
    assert "4.5 cm" in row


def test_log_column_is_that_of_the_worst_repetition() -> None:
    text = page_of(
        killed(0, 0.1, logged=100, lost=0, lost_events=1), killed(1, 0.1, logged=90, lost=10)
    )
    assert "10 of 100, 1 events" in text


def test_arrivals_are_counted_with_reasons_of_the_others() -> None:
    arrived = Repetition(fault="20 % lost", way="lockstep", number=0, reached=True)
    stopped = Repetition(fault="20 % lost", way="lockstep", number=1, reason="TICKS_LOST")
    assert "1 arrived, else TICKS_LOST (2)" in page_of(arrived, stopped)


def test_missed_ticks_are_counted() -> None:
    name = "disk slow: fsync takes 2 s"
    found = [
        Repetition(fault=name, way="wall", number=number, reached=True, missed_ticks=missed)
        for number, missed in enumerate((0, 0, 2))
    ]
    assert "2 arrived, 0 ticks missed (2)" in page_of(*found[:2])
    text = page_of(*found)
    assert "3 arrived, 2 ticks missed **1 of 3 missed**" in text
    assert f"- **{name}** in wall, 1 of 3: missed 2 ticks" in text


def test_rows_not_measured_now_are_kept() -> None:
    cut = Repetition(fault="robot | plant", way="wall", number=0, stood_s=0.33, known_s=0.2)
    before = page_of(killed(0, 0.15), cut)
    after = page_of(killed(0, 0.19), before=before)
    assert "150 / 150 (1)" not in after
    assert "190 / 190 (1)" in after
    (row,) = [line for line in before.splitlines() if line.startswith("| robot \\| plant |")]
    assert "330 / 330" in row
    assert row in after.splitlines()
    assert len(after.splitlines()) == len(before.splitlines()) + 2
    assert "- **robot | plant** in wall, 1 of 1: " in after
    assert "- Apart from the others, on 20" in after
    assert "(cores 2): robot killed." in after


@each("kind", [SonarScan, WheelTicks, Teleop, CommandRequest])
def test_each_field_takes_each_of_its_limits(kind: type[SonarScan]) -> None:
    found = list(extremes_of(kind))
    for field in LAYOUT[kind.__name__].fields:
        values = [getattr(message, field.name) for message in found]
        if field.is_text:
            assert {*map(len, values)} == {field.length}
            continue
        numbers = [value[0] if field.length else value for value in values]
        if field.limits is None:
            assert any(map(isnan, numbers))
            assert any(map(isinf, numbers))
        else:
            assert (min(numbers), max(numbers)) == field.limits


@each("topic", RECEIVED)
def test_each_frame_is_readable(topic: object) -> None:
    for frame in extremes(topic):  # type: ignore[arg-type]
        assert isinstance(decode(frame).message, topic.messages)  # type: ignore[attr-defined]


def test_turns_have_one_frame_per_topic_and_stops_last() -> None:
    sent = list(turns())
    for turn in sent:
        topics = [topic.path for topic, _ in turn]
        assert len(set(topics)) == len(topics)
    assert sum(map(len, sent)) == sum(len(list(extremes(topic))) for topic in RECEIVED)
    first = next(number for number, turn in enumerate(sent) if turn[0][0] is TOPICS_STOP)
    assert all(turn[0][0] is TOPICS_STOP for turn in sent[first:])
    assert {topic.path for turn in sent[:first] for topic, _ in turn} == {one.path for one in READ}


@each("number", range(4))
def test_acknowledged_changes_survive(number: int) -> None:
    one = restarts.run("a cut", "lockstep", number)
    assert (one.reached, one.trouble) == (True, "")


def test_unsynchronised_rename_is_found() -> None:
    found = [restarts.run("a cut", "lockstep", number, UnsyncedRenames()) for number in range(8)]
    assert any("instead of SavedState" in one.trouble for one in found)
