"""Acknowledged values are on the disk, and the control loop never waits for the disk."""

import builtins
import io
import json
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from checks.harness.until import until
from protocol.topics import MISSION_SERVICE, PARAMETER
from protocol.wire.codec import Encoder
from protocol.wire.enums import AckResult, MissionType, Severity
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    MissionClearAll,
    MissionVerdict,
    ParamSet,
    ParamValue,
)
from protocol.wire.reasons import Reason
from robot.core.parameters import DEFAULTS
from robot.emergency_stop import emergency_stop
from robot.file_writer import Directory, Done, Job, WriterThread
from robot.reports import MAX_WITHHELD, SAVING, SavedReplies
from robot.storage import PreviousRun, Store
from runtime import files as atomic_file
from tests.support.robots import (
    ADA,
    Desk,
    HeldWriter,
    Question,
    Rig,
    circle,
    count_of,
    goal,
    line,
    upload,
)

FULL = OSError(28, "No space left on device")


def setting(value: float, name: str = "d_obs_m") -> ParamSet:
    return ParamSet(param_id=name, param_value=value, param_type=9)


class Robot:
    """A vehicle with a delayed disk, and its replies."""

    def __init__(self, folder: Path) -> None:
        self.writer = HeldWriter()
        self.desk = Desk(Store(folder, self.writer))
        self.desk.vehicle.restore()
        self.desk.arm()
        self.replies = SavedReplies(self.desk.vehicle)

    def ask(self, request: Message) -> Question:
        asked = Question(request)
        answer = self.desk.vehicle.receive(request, self.desk.now_ns)
        self.replies.reply(asked, request, answer, self.desk.now_ns)
        return asked

    def finish(self, error: OSError | None = None) -> None:
        self.writer.finish(error)
        self.settle()

    def settle(self, after_s: float = 0.0) -> None:
        """Run `settle` as the loop does in each tick, after this time."""
        self.desk.now_ns += round(after_s * 1e9)
        self.replies.settle(self.desk.now_ns)

    def errors(self) -> list[str]:
        texts = self.desk.vehicle.texts()
        return [text.text for text in texts if text.severity == Severity.ERROR]


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    return Robot(tmp_path / "state")


def saved_value(folder: Path) -> float:
    return Store(folder).load(DEFAULTS)[0].d_obs_m


def reason(asked: Question) -> int:
    (answer,) = asked.answers
    return answer.reason if isinstance(answer, MissionVerdict) else reason_of(answer)


def reason_of(answer: Message | bytes) -> int:
    return answer.result_param2 if isinstance(answer, CommandAck) else Reason.NONE


def test_value_is_in_force_at_once_and_acknowledged_later(robot: Robot, tmp_path: Path) -> None:
    asked = robot.ask(setting(0.45))
    robot.settle()
    assert robot.desk.vehicle.params.d_obs_m == 0.45
    assert asked.answers == []
    robot.finish()
    assert saved_value(tmp_path / "state") == 0.45
    (answer,) = asked.answers
    assert isinstance(answer, ParamValue)


def test_failed_write_is_answered_and_announced(robot: Robot) -> None:
    robot.errors()
    asked = robot.ask(setting(0.45))
    robot.finish(FULL)
    assert reason(asked) == Reason.NOT_SAVED
    assert robot.errors() == ["parameters not saved: No space left on device"]
    assert robot.errors() == []


def test_repeated_request_after_a_failure_is_written(robot: Robot, tmp_path: Path) -> None:
    robot.ask(setting(0.45))
    robot.finish(FULL)
    again = robot.ask(setting(0.45))
    robot.finish()
    assert reason(again) == Reason.NONE
    assert saved_value(tmp_path / "state") == 0.45


def test_request_repeated_on_a_slow_disk_is_written_once(robot: Robot) -> None:
    asked = [robot.ask(setting(0.45)) for _ in range(3)]
    assert len(robot.writer.waiting) == 1
    robot.finish()
    assert [reason(one) for one in asked] == [Reason.NONE] * 3
    assert robot.writer.waiting == []


def test_slow_disk_receives_only_the_newest_values(robot: Robot, tmp_path: Path) -> None:
    asked = [robot.ask(setting(0.2 + number / 100)) for number in range(20)]
    assert len(robot.writer.waiting) == 1, "bounded: one job of a file at a time"
    robot.finish()
    assert [len(one.answers) for one in asked] == [1] + [0] * 19
    assert len(robot.writer.waiting) == 1
    robot.finish()
    assert all(reason(one) == Reason.NONE for one in asked)
    assert saved_value(tmp_path / "state") == 0.39


def test_newer_content_saves_an_older_failed_one(robot: Robot) -> None:
    """Newer content contains both values."""
    first, second = robot.ask(setting(0.45)), robot.ask(setting(0.6, "k_rho"))
    robot.writer.finish(FULL)
    robot.desk.vehicle.collect_saved()
    robot.writer.finish()
    robot.settle()
    assert (reason(first), reason(second)) == (Reason.NONE, Reason.NONE)


def test_a_refusal_does_not_wait_for_the_disk(robot: Robot) -> None:
    robot.ask(setting(0.45))
    assert reason(robot.ask(setting(99.0))) == Reason.PARAMETER_OUT_OF_RANGE


def test_requests_beyond_a_limit_are_rejected_temporarily(robot: Robot) -> None:
    asked = [robot.ask(setting(0.45)) for _ in range(MAX_WITHHELD + 3)]
    early = [one for one in asked if one.answers]
    assert early == asked[MAX_WITHHELD:]
    (answer,) = early[0].answers
    assert isinstance(answer, CommandAck)
    assert answer.result == AckResult.TEMPORARILY_REJECTED
    robot.finish()
    assert all(len(one.answers) == 1 for one in asked)


def test_slow_disk_is_answered_as_in_progress(robot: Robot) -> None:
    first = robot.ask(setting(0.45))
    robot.settle(after_s=0.3)
    assert first.answers == []
    robot.settle(after_s=0.05)
    assert first.answers == [SAVING]
    again = robot.ask(setting(0.45))
    robot.finish()
    assert reason(again) == Reason.NONE
    assert len(first.answers) == 1


def asked_for(robot: Robot, seconds: float) -> list[Message | bytes]:
    """Return the answers to an operator that repeats its request."""
    answers: list[Message | bytes] = []
    for _ in range(round(seconds / 0.4)):
        asked = robot.ask(setting(0.45))
        robot.settle(after_s=0.4)
        answers += asked.answers
    return answers


def test_hung_disk_is_announced_once_and_answered_not_saved(robot: Robot) -> None:
    assert asked_for(robot, 2.8) == [SAVING] * 7
    assert slow(robot) == []
    assert set(asked_for(robot, 6.8)) == {SAVING}
    assert slow(robot) == ["not saved for 3 s: the disk is slow, or it hangs"]
    assert [reason_of(answer) for answer in asked_for(robot, 2.0)][1:] == [Reason.NOT_SAVED] * 4
    again = robot.ask(setting(0.45))
    robot.finish()
    assert reason(again) == Reason.NONE, "it has only been slow"
    robot.ask(setting(0.5))
    robot.settle(after_s=0.4)
    assert slow(robot) == [], "a new write has its own time"


def test_slow_disk_with_progress_does_not_count_as_hung(robot: Robot) -> None:
    for number in range(20):
        robot.ask(setting(0.2 + number / 100))
        robot.ask(setting(0.21 + number / 100))
        robot.settle(after_s=0.9)
        robot.finish()
    assert slow(robot) == []


def slow(robot: Robot) -> list[str]:
    texts = robot.desk.vehicle.texts()
    return [text.text for text in texts if text.severity == Severity.WARNING]


def test_a_fence_and_its_removal_are_acknowledged_once_durable(
    robot: Robot, tmp_path: Path
) -> None:
    fence = circle(0.0, 0.0, 2.0)
    robot.ask(count_of(fence))
    put = robot.ask(fence[0])
    assert robot.desk.goto(3.0, 0.0) == Reason.OUTSIDE_FENCE, "in force at once"
    assert put.answers == []
    robot.finish()
    assert reason(put) == Reason.NONE
    assert (tmp_path / "state" / "fence.json").exists()
    off = robot.ask(MissionClearAll(mission_type=MissionType.FENCE))
    assert off.answers == []
    robot.finish()
    assert reason(off) == Reason.NONE
    assert not (tmp_path / "state" / "fence.json").exists()


def test_the_last_item_repeated_has_the_answer_of_the_disk(robot: Robot) -> None:
    items = line(2)
    robot.ask(count_of(items))
    robot.ask(items[0])
    first, second = robot.ask(items[1]), robot.ask(items[1])
    robot.finish(FULL)
    third = robot.ask(items[1])
    assert [reason(one) for one in (first, second, third)] == [Reason.NOT_SAVED] * 3


def test_list_marks_only_durable_values_as_saved(robot: Robot) -> None:
    robot.ask(setting(0.45))
    assert saved_names(robot) == []
    robot.finish()
    assert saved_names(robot) == ["d_obs_m"]
    robot.ask(setting(0.5))
    robot.finish(FULL)
    assert saved_names(robot) == []


def saved_names(robot: Robot) -> list[str]:
    rows = json.loads(robot.desk.vehicle.parameters.describe())
    return [row["name"] for row in rows if row["saved"]]


def test_end_waits_for_pending_writes(robot: Robot, tmp_path: Path) -> None:
    asked = robot.ask(setting(0.45))
    robot.desk.vehicle.finish_saving(1.0)
    robot.settle()
    assert reason(asked) == Reason.NONE
    assert saved_value(tmp_path / "state") == 0.45


def test_end_saves_content_that_arrived_during_a_write(robot: Robot, tmp_path: Path) -> None:
    asked = [robot.ask(setting(value)) for value in (0.45, 0.5, 0.55)]
    robot.desk.vehicle.finish_saving(1.0)
    robot.settle()
    assert [reason(one) for one in asked] == [Reason.NONE] * 3
    assert saved_value(tmp_path / "state") == 0.55


# The thread.


@pytest.fixture
def thread() -> Iterator[WriterThread]:
    one = WriterThread()
    yield one
    one.close(10.0)


def fails_in(loop: threading.Thread, real: Callable[..., Any]) -> Callable[..., Any]:
    def guarded(*given: Any, **named: Any) -> Any:
        assert threading.current_thread() is not loop, f"{real.__name__} in the control loop"
        return real(*given, **named)

    return guarded


def test_the_control_loop_touches_no_disk(
    tmp_path: Path, thread: WriterThread, monkeypatch: pytest.MonkeyPatch
) -> None:
    desk = Desk(Store(tmp_path / "state", thread))
    desk.vehicle.restore()
    desk.arm()
    with untouchable(monkeypatch):
        upload(desk, line(2))
        upload(desk, circle(0.0, 0.0, 3.0))
        desk.vehicle.receive(setting(0.45), desk.now_ns)
        for kind in (MissionType.FENCE, MissionType.MISSION):
            desk.vehicle.receive(MissionClearAll(mission_type=kind), desk.now_ns)
        until(lambda: not unsaved(desk), what="all that was asked is saved")
    assert sorted(path.name for path in (tmp_path / "state").iterdir()) == ["parameters.json"]


def test_no_control_period_touches_the_disk(
    tmp_path: Path, thread: WriterThread, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Run the whole loop: requests and answers, telemetry, a stop, and the marks of a run."""
    store = Store(tmp_path / "state", thread)
    rig, life = Rig(store).ready(), PreviousRun(store.directory)
    life.begin()
    fence = circle(0.0, 0.0, 9.0)
    with untouchable(monkeypatch):
        asked = [rig.ask(one, service=PARAMETER) for one in (setting(0.45), setting(0.5))]
        items = [count_of(line(2)), *line(2), count_of(fence), *fence]
        for one in (*items, MissionClearAll(mission_type=MissionType.FENCE)):
            asked.append(rig.ask(one, service=MISSION_SERVICE))
            rig.cycle()
        asked.append(rig.ask(goal(1, 3.0, 0.0)))
        rig.bus.press(ADA, Encoder(1, 1).encode(emergency_stop(7)))

        def answered() -> bool:
            rig.cycle()
            rig.process.idle()
            return all(one.answers for one in asked)

        until(answered, what="an answer to each request")
        rig.process.run(iter(()))
        life.end()
    assert rig.vehicle.stopped
    rig.process.finish()
    names = sorted(path.name for path in (tmp_path / "state").iterdir())
    assert names == ["life.txt", "mission.json", "parameters.json", "stop.txt"]


@contextmanager
def untouchable(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Fail if this thread uses the file system within the block."""
    with monkeypatch.context() as patch:
        loop = threading.current_thread()
        for name in ("open", "fsync", "write", "replace", "unlink", "mkdir", "stat", "close"):
            patch.setattr(os, name, fails_in(loop, getattr(os, name)))
        for module in (builtins, io):
            patch.setattr(module, "open", fails_in(loop, builtins.open))
        yield


def unsaved(desk: Desk) -> list[str]:
    desk.vehicle.collect_saved()
    directory = desk.vehicle._store.directory
    files = [directory.file(name) for name in ("parameters", "fence", "mission")]
    return [file.name for file in files if file is not None and file.ticket.is_open]


def test_the_thread_survives_a_defect_and_reports_it(
    tmp_path: Path, thread: WriterThread, monkeypatch: pytest.MonkeyPatch
) -> None:
    def defective(*_: object) -> None:
        raise ZeroDivisionError("as the test wants it")

    with monkeypatch.context() as patch:
        patch.setattr(atomic_file, "replace", defective)
        assert "ZeroDivisionError: as the test wants it" in str(ended(thread, tmp_path, "1").error)
    assert ended(thread, tmp_path, "2").error is None
    assert (tmp_path / "one.json").read_text() == "2"


def ended(thread: WriterThread, folder: Path, text: str) -> Done:
    """Submit a content and wait for its end."""
    thread.submit(Job(folder / "one.json", text, 1))
    found: list[Done] = []

    def has_ended() -> bool:
        found.extend(thread.done())
        return bool(found)

    until(has_ended, what="the end of the job")
    return found[0]


def test_without_a_path_no_file_is_kept() -> None:
    assert Directory(None).file("fence") is None
