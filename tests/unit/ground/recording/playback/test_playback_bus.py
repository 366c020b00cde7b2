"""A recording is listened to like a live bus: played, paused, stepped, gone through by marks."""

import json
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest

from ground.recording.playback.playback_bus import ReplayBus
from protocol.topics import (
    ANSWERED,
    CLOCK,
    COMMAND,
    HEARTBEAT,
    ODOMETRY,
    PARAMETERS,
    STATUS,
    TEXT,
    WORLD,
)
from protocol.wire.enums import GoalState, Severity, Vehicle
from protocol.wire.messages import CommandRequest, ParamValue, Statustext
from protocol.wire.reasons import Reason
from runtime.clock import ManualClock
from runtime.errors import LocalError, NoAnswer, UserError
from tests.support.ground.recording.made import (
    PERIOD_US,
    START_US,
    Said,
    Speaker,
    mcap,
    run,
    status,
    system_time,
    tlog,
)

S = 1_000_000_000
Opens = Callable[[list[Said]], ReplayBus]


@pytest.fixture
def clock() -> ManualClock:
    return ManualClock(77 * S)


@pytest.fixture
def opens(tmp_path: Path, clock: ManualClock) -> Opens:
    return lambda said: ReplayBus(mcap(tmp_path / "a.mcap", said), clock)


@pytest.fixture
def bus(opens: Opens) -> ReplayBus:
    return opens(list(run()))


def test_it_stands_at_the_beginning_and_gives_only_what_came_first(bus: ReplayBus) -> None:
    box = bus.mailbox(ODOMETRY)
    assert bus.advance() == 1
    assert box.latest() is None
    assert bus.timeline.now_ns() == START_US * 1000


def test_played_it_runs_as_fast_as_it_was(bus: ReplayBus, clock: ManualClock) -> None:
    box = bus.mailbox(ODOMETRY)
    bus.timeline.play()
    clock.advance(S)
    bus.advance()
    newest = box.latest()
    assert newest is not None
    message, arrived_ns = newest
    assert message.time_ns == 19 * PERIOD_US * 1000
    assert bus.timeline.now_ns() - arrived_ns == PERIOD_US * 1000 - 300_000
    assert box.fresh(bus.timeline.now_ns()) is not None


def test_it_can_be_played_faster_and_paused(bus: ReplayBus, clock: ManualClock) -> None:
    bus.timeline.play(4.0)
    clock.advance(S // 4)
    assert bus.timeline.position_s == 1.0
    bus.timeline.pause()
    clock.advance(10 * S)
    assert bus.timeline.position_s == 1.0
    bus.timeline.play()
    clock.advance(S // 8)
    assert bus.timeline.position_s == 1.5


def test_at_the_end_it_stops_by_itself(bus: ReplayBus, clock: ManualClock) -> None:
    bus.timeline.play()
    clock.advance(100 * S)
    bus.advance()
    assert bus.timeline.position_ns == bus.timeline.duration_ns == 40 * PERIOD_US * 1000
    assert not bus.timeline.playing
    assert bus.advance() == 0


@pytest.mark.parametrize(("asked", "got"), [(1e9, 64.0), (0.0, 0.0625)])
def test_a_speed_that_makes_no_sense_is_held(bus: ReplayBus, asked: float, got: float) -> None:
    bus.timeline.play(asked)
    assert bus.timeline.speed == got


def test_every_frame_comes_once_and_in_order(bus: ReplayBus, clock: ManualClock) -> None:
    heard: list[bytes] = []
    bus.stream("sidestep/r1/**", lambda _key, frame, _at: heard.append(frame))
    bus.timeline.play()
    for _ in range(30):
        clock.advance(S // 9)
        bus.advance()
    assert heard == [one.frame for one in run()]


def test_seeking_forwards_shows_the_way_and_backwards_begins_anew(bus: ReplayBus) -> None:
    box, looks = bus.mailbox(STATUS), []
    bus.seek(1.5, lambda: looks.append(bus.timeline.position_s))
    assert looks == pytest.approx([0.2 * n for n in range(1, 8)] + [1.5])
    newest = box.latest()
    assert newest is not None
    assert newest[0].time_ns == int(1.45 * S)
    with pytest.raises(LocalError, match="rewind"):
        bus.seek(0.5)
    bus.rewind()
    again = bus.mailbox(STATUS)
    bus.seek(0.5)
    newest = again.latest()
    assert newest is not None
    assert newest[0].time_ns == int(0.45 * S)
    before = box.latest()
    assert before is not None
    assert before[0].time_ns == int(1.45 * S), "who is not listening any more hears nothing"


def test_far_back_every_event_is_heard_and_of_streams_enough_to_see_the_way(opens: Opens) -> None:
    speaker = Speaker()
    said = []
    for tick in range(20 * 300):
        at_us = START_US + tick * PERIOD_US
        said.append(speaker.say(STATUS, status(tick * PERIOD_US * 1000), at_us))
        if tick % 1000 == 0:
            text = Statustext(severity=Severity.INFO, text=f"n{tick}")
            said.append(speaker.say(TEXT, text, at_us))
    bus = opens(said)
    texts: list[bytes] = []
    heard: list[int] = []
    bus.stream(TEXT, lambda _key, frame, _at: texts.append(frame))
    bus.stream(STATUS, lambda _key, _frame, at_ns: heard.append(at_ns))
    looks: list[int] = []
    bus.seek(299.0, lambda: looks.append(len(heard)))
    assert len(texts) == 6
    assert 2000 < len(heard) < 3000, "the last minute whole, of what was before one in four"
    assert max(later - before for before, later in pairwise(heard)) < S
    assert len(looks) < 1600


def test_a_step_is_a_tick_whole(bus: ReplayBus) -> None:
    box = bus.mailbox(STATUS)
    here_s = 0.0
    for tick in range(1, 5):
        here_s = bus.tick_after(here_s)
        bus.seek(here_s)
        newest = box.latest()
        assert newest is not None
        assert newest[0].time_ns == tick * PERIOD_US * 1000 - PERIOD_US * 1000
    assert bus.tick_after(here_s, -2) < here_s
    assert bus.tick_after(1e6) == bus.timeline.duration_ns / S
    assert bus.tick_after(-5.0, -1) >= 0.0


def test_marks_are_goals_and_how_they_ended(bus: ReplayBus) -> None:
    assert [(mark.kind, mark.text) for mark in bus.marks] == [
        ("goal", "goal 5.40 2.00"),
        ("outcome", "REACHED"),
    ]
    first = bus.mark_after(0.0)
    assert first == bus.marks[0]
    assert first.time_s == pytest.approx(0.5, abs=0.01)
    assert bus.mark_after(first.time_s) == bus.marks[1]
    assert bus.mark_after(100.0) is None
    assert bus.mark_after(100.0, back=True) == bus.marks[1]
    assert bus.mark_after(first.time_s, back=True) is None


def test_a_failsafe_is_a_mark_with_its_reason(opens: Opens) -> None:
    speaker = Speaker()
    tripped = status(0, GoalState.ABORTED, Vehicle.FAILSAFE, Reason.BUMPER)
    bus = opens([*run(4), speaker.say(STATUS, tripped, START_US + 200_000)])
    assert ("failsafe", "FAILSAFE: bumper contact") in [(m.kind, m.text) for m in bus.marks]


def test_world_and_parameters_are_answered_from_the_recording(bus: ReplayBus) -> None:
    world = bus.ask(WORLD)
    assert isinstance(world, bytes)
    assert json.loads(world)["name"] == "made"
    with pytest.raises(NoAnswer, match="does not hold the parameters"):
        bus.ask(PARAMETERS)
    stop = CommandRequest(request_id=1, param1=0.0, param2=0.0, command=400)
    with pytest.raises(NoAnswer, match="this is a recording"):
        bus.ask(COMMAND, stop)


def test_a_parameter_has_the_value_of_the_moment(bus: ReplayBus, opens: Opens) -> None:
    said = list(run())
    value = ParamValue(
        param_id="d_obs_m", param_value=0.4, param_type=9, param_count=1, param_index=0
    )
    said.insert(100, Speaker().say(ANSWERED, value, said[99].time_us))
    bus = opens(said)
    bus.reel.facts["parameters"] = '[{"name": "d_obs_m", "value": 0.3}]'
    assert rows_in(bus.ask(PARAMETERS)) == [{"name": "d_obs_m", "value": 0.3}]
    bus.seek(2.0)
    assert rows_in(bus.ask(PARAMETERS)) == [{"name": "d_obs_m", "value": 0.4}]


def rows_in(answer: object) -> object:
    assert isinstance(answer, bytes)
    return json.loads(answer)


def test_who_was_heard_is_there(bus: ReplayBus) -> None:
    assert bus.present() == []
    bus.seek(1.0)
    assert sorted(one.role for one in bus.present()) == ["ground", "plant", "robot"]


def test_who_fell_silent_is_not(opens: Opens) -> None:
    late = Speaker().say(STATUS, status(0), START_US + 60 * 1_000_000)
    bus = opens([*run(4), late])
    bus.seek(50.0)
    assert bus.present() == []


def test_lockstep_is_played_by_its_stamps_not_by_how_fast_it_was_computed(opens: Opens) -> None:
    speaker, said = Speaker(), []
    for tick in range(100):
        at_us = START_US + tick * 100  # 50 ms in a tenth of a millisecond
        said.append(speaker.say(CLOCK, system_time(tick * PERIOD_US), at_us))
        said.append(speaker.say(STATUS, status(tick * PERIOD_US * 1000), at_us + 50))
    bus = opens(said)
    box = bus.mailbox(STATUS)
    assert bus.timeline.duration_ns == 99 * PERIOD_US * 1000
    bus.seek(2.0)
    newest = box.latest()
    assert newest is not None
    assert newest[0].time_ns == 2 * S
    assert box.fresh(bus.timeline.now_ns()) is not None


def test_a_tlog_is_played_too_and_says_what_it_does_not_hold(
    tmp_path: Path, clock: ManualClock
) -> None:
    bus = ReplayBus(tlog(tmp_path / "20260304T120005Z-r7.tlog", list(run(8, "r7"))), clock)
    box = bus.mailbox(HEARTBEAT, "r7")
    bus.seek(1.0)
    assert box.latest() is not None
    with pytest.raises(NoAnswer, match="does not hold the world"):
        bus.ask(WORLD)


def test_what_holds_no_frame_is_refused_with_the_reason(tmp_path: Path, clock: ManualClock) -> None:
    path = tmp_path / "a.tlog"
    path.write_bytes(b"nothing of the kind")
    with pytest.raises(UserError, match=r"holds no frame .*19 bytes"):
        ReplayBus(path, clock)
