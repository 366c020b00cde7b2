"""A recording replaces a live bus, and `replay --plain` prints it in order of time."""

import json
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest

from checks.harness.messages import make
from ground.cli.main import main, parse
from ground.cli.observe.replay import show_lines
from ground.recording.playback import ReplayBus
from ground.station.station import Station
from ground.text.output import Output
from protocol.topics import (
    ANSWERED,
    CLOCK,
    COMMAND,
    HEARTBEAT,
    MARK,
    ODOMETRY,
    PARAMETERS,
    STATUS,
    TEXT,
    TOPICS,
    WORLD,
)
from protocol.wire.enums import GoalState, Severity, Vehicle
from protocol.wire.messages import CommandRequest, ParamValue, Statustext
from protocol.wire.reasons import Reason
from protocol.wire.statustext import pieces_of
from runtime.clock import ManualClock
from runtime.errors import LocalError, NoAnswerError, UserError
from runtime.units import NS_PER_S as S
from tests.support.ground.made_recordings import (
    PERIOD_US,
    START_US,
    PublishedFrame,
    TopicEncoder,
    mcap,
    run,
    status,
    system_time,
    tlog,
)

Opens = Callable[[list[PublishedFrame]], ReplayBus]


@pytest.fixture
def clock() -> ManualClock:
    return ManualClock(77 * S)


@pytest.fixture
def opens(tmp_path: Path, clock: ManualClock) -> Opens:
    return lambda frames_sent: ReplayBus(mcap(tmp_path / "a.mcap", frames_sent), clock)


@pytest.fixture
def bus(opens: Opens) -> ReplayBus:
    return opens(list(run()))


def test_playback_starts_paused_at_the_first_frame(bus: ReplayBus) -> None:
    box = bus.mailbox(ODOMETRY)
    assert bus.advance() == 1
    assert box.latest() is None
    assert bus.timeline.now_ns() == START_US * 1000


def test_playback_runs_at_recorded_speed(bus: ReplayBus, clock: ManualClock) -> None:
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


def test_playback_speed_and_pause(bus: ReplayBus, clock: ManualClock) -> None:
    bus.timeline.play(4.0)
    clock.advance(S // 4)
    assert bus.timeline.position_s == 1.0
    bus.timeline.pause()
    clock.advance(10 * S)
    assert bus.timeline.position_s == 1.0
    bus.timeline.play()
    clock.advance(S // 8)
    assert bus.timeline.position_s == 1.5


def test_playback_stops_at_the_end(bus: ReplayBus, clock: ManualClock) -> None:
    bus.timeline.play()
    clock.advance(100 * S)
    bus.advance()
    assert bus.timeline.position_ns == bus.timeline.duration_ns == 40 * PERIOD_US * 1000
    assert not bus.timeline.playing
    assert bus.advance() == 0


@pytest.mark.parametrize(("requested", "got"), [(1e9, 64.0), (0.0, 0.0625)])
def test_playback_speed_is_clamped(bus: ReplayBus, requested: float, got: float) -> None:
    bus.timeline.play(requested)
    assert bus.timeline.speed == got


def test_frames_are_delivered_once_and_in_order(bus: ReplayBus, clock: ManualClock) -> None:
    received: list[bytes] = []
    for topic in TOPICS:
        bus.stream(topic, lambda _key, frame, _at: received.append(frame))
    bus.timeline.play()
    for _ in range(30):
        clock.advance(S // 9)
        bus.advance()
    assert received == [one.frame for one in run()]


def test_seek_forwards_delivers_and_backwards_needs_rewind(bus: ReplayBus) -> None:
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
    assert before[0].time_ns == int(1.45 * S), "a dropped subscription receives nothing"


def test_long_seek_delivers_events_and_samples_of_streams(opens: Opens) -> None:
    encoder = TopicEncoder()
    frames_sent = []
    for tick in range(20 * 300):
        at_us = START_US + tick * PERIOD_US
        frames_sent.append(encoder.publish(STATUS, status(tick * PERIOD_US * 1000), at_us))
        if tick % 1000 == 0:
            text = Statustext(severity=Severity.INFO, text=f"n{tick}")
            frames_sent.append(encoder.publish(TEXT, text, at_us))
    bus = opens(frames_sent)
    texts: list[bytes] = []
    received: list[int] = []
    bus.stream(TEXT, lambda _key, frame, _at: texts.append(frame))
    bus.stream(STATUS, lambda _key, _frame, at_ns: received.append(at_ns))
    looks: list[int] = []
    bus.seek(299.0, lambda: looks.append(len(received)))
    assert len(texts) == 6
    assert 2000 < len(received) < 3000, "the last minute whole, one in four before it"
    assert max(later - before for before, later in pairwise(received)) < S
    assert len(looks) < 1600


def test_step_delivers_one_whole_tick(bus: ReplayBus) -> None:
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


def test_bookmarks_are_goals_and_outcomes(bus: ReplayBus) -> None:
    assert [(mark.kind, mark.text) for mark in bus.marks] == [
        ("goal", "goal 5.40 2.00"),
        ("outcome", "REACHED"),
    ]
    first = bus.next_mark(0.0)
    assert first == bus.marks[0]
    assert first.time_s == pytest.approx(0.5, abs=0.01)
    assert bus.next_mark(first.time_s) == bus.marks[1]
    assert bus.next_mark(100.0) is None


def test_failsafe_is_a_bookmark_with_its_reason(opens: Opens) -> None:
    encoder = TopicEncoder()
    tripped = status(0, GoalState.ABORTED, Vehicle.FAILSAFE, Reason.BUMPER)
    bus = opens([*run(4), encoder.publish(STATUS, tripped, START_US + 200_000)])
    assert ("failsafe", "FAILSAFE: bumper contact") in [(m.kind, m.text) for m in bus.marks]


def test_recorded_facts_answer_requests(bus: ReplayBus) -> None:
    world = bus.ask(WORLD)
    assert isinstance(world, bytes)
    assert json.loads(world)["name"] == "made"
    with pytest.raises(NoAnswerError, match="does not hold the parameters"):
        bus.ask(PARAMETERS)
    stop = CommandRequest(request_id=1, param1=0.0, param2=0.0, command=400)
    with pytest.raises(NoAnswerError, match="a recording cannot answer requests"):
        bus.ask(COMMAND, stop)


def test_parameter_has_its_value_at_the_position(bus: ReplayBus, opens: Opens) -> None:
    frames_sent = list(run())
    value = make(ParamValue, param_id="d_obs_m", param_value=0.4, param_count=1)
    frames_sent.insert(100, TopicEncoder().publish(ANSWERED, value, frames_sent[99].time_us))
    bus = opens(frames_sent)
    bus.log_index.facts["parameters"] = '[{"name": "d_obs_m", "value": 0.3}]'
    assert rows_in(bus.ask(PARAMETERS)) == [{"name": "d_obs_m", "value": 0.3}]
    bus.seek(2.0)
    assert rows_in(bus.ask(PARAMETERS)) == [{"name": "d_obs_m", "value": 0.4}]


def rows_in(answer: object) -> object:
    assert isinstance(answer, bytes)
    return json.loads(answer)


def test_present_lists_recent_senders(bus: ReplayBus) -> None:
    assert bus.present() == []
    bus.seek(1.0)
    assert sorted(one.role for one in bus.present()) == ["ground", "plant", "robot"]


def test_all_robots_of_a_recording_are_played(opens: Opens) -> None:
    both = sorted([*run(), *run(robot="r2")], key=lambda one: one.time_us)
    bus = opens(both)
    assert bus.log_index.robots == ("r1", "r2")
    assert [mark.text for mark in bus.marks] == [mark.text for mark in opens(list(run())).marks]
    station = Station(bus, "r1", bus.timeline)
    bus.seek(1.5, station.poll)
    station.poll()
    assert [(entry.robot, entry.words) for entry in station.roster()] == [
        ("r1", "driving"),
        ("r2", "driving"),
    ]
    assert [other.name for other in station.scene().others] == ["r2"]
    assert len(station.scene().others[0].trail) > 1
    station.select("r2")
    assert len(station.history["speed"].points()) > 5


def test_silent_senders_are_not_present(opens: Opens) -> None:
    late = TopicEncoder().publish(STATUS, status(0), START_US + 60 * 1_000_000)
    bus = opens([*run(4), late])
    bus.seek(50.0)
    assert bus.present() == []


def test_lockstep_is_played_by_its_stamps(opens: Opens) -> None:
    encoder, frames_sent = TopicEncoder(), []
    for tick in range(100):
        at_us = START_US + tick * 100  # 50 ms in a tenth of a millisecond
        frames_sent.append(encoder.publish(CLOCK, system_time(tick * PERIOD_US), at_us))
        frames_sent.append(encoder.publish(STATUS, status(tick * PERIOD_US * 1000), at_us + 50))
    bus = opens(frames_sent)
    box = bus.mailbox(STATUS)
    assert bus.timeline.duration_ns == 99 * PERIOD_US * 1000
    bus.seek(2.0)
    newest = box.latest()
    assert newest is not None
    assert newest[0].time_ns == 2 * S
    assert box.fresh(bus.timeline.now_ns()) is not None


def test_tlog_is_played_without_facts(tmp_path: Path, clock: ManualClock) -> None:
    bus = ReplayBus(tlog(tmp_path / "20260304T120005Z-r7.tlog", list(run(8, "r7"))), clock)
    box = bus.mailbox(HEARTBEAT, "r7")
    bus.seek(1.0)
    assert box.latest() is not None
    with pytest.raises(NoAnswerError, match="does not hold the world"):
        bus.ask(WORLD)


def test_file_without_frames_is_rejected(tmp_path: Path, clock: ManualClock) -> None:
    path = tmp_path / "a.tlog"
    path.write_bytes(b"nothing of the kind")
    with pytest.raises(UserError, match=r"holds no frame .*19 bytes"):
        ReplayBus(path, clock)


@pytest.fixture
def log(tmp_path: Path) -> str:
    frames_sent = list(run(60))
    (remark,) = pieces_of("a cart", 1, Severity.NOTICE)
    frames_sent.insert(200, TopicEncoder().publish(MARK, remark, frames_sent[199].time_us))
    return str(mcap(tmp_path / "a.mcap", frames_sent))


def test_replay_prints_a_line_a_second_with_texts(
    log: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", log, "--plain"]) == 0
    *lines, last = capsys.readouterr().out.splitlines()
    times = [float(line.split()[0]) for line in lines]
    assert times == sorted(times)
    assert [time for time in times if time == int(time)] == [0.0, 1.0, 2.0, 3.0, 3.0]
    assert any("goal: goal 5.40 2.00" in line for line in lines)
    assert any("mark: a cart" in line for line in lines)
    assert "outcome: REACHED" in "\n".join(lines)
    assert lines[-2].endswith("robot: goal reached")
    assert "ACTIVE GUIDED REACHED" in lines[-1]
    assert last.endswith("frames of r1 in 3.0 s")


def test_replay_at_an_instant_shows_earlier_values(
    log: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", log, "--plain", "--at", "2.5"]) == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert first.startswith("    2.50  ACTIVE GUIDED DRIVING  pose 1.0")


def test_replay_json_lists_the_contents(log: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", log, "--json"]) == 0
    reported = json.loads(capsys.readouterr().out)
    assert reported["duration_s"] == 3.0
    assert [mark["kind"] for mark in reported["marks"]] == ["goal", "mark", "outcome"]
    assert reported["facts"] == ["world"]


def test_replay_speed_sets_its_duration(log: str, capsys: pytest.CaptureFixture[str]) -> None:
    clock = ManualClock()
    options = parse(["replay", log, "--plain", "--speed", "2"])
    assert show_lines(options, Output(as_json=False), clock) == 0
    assert clock.now_ns() == 1_500_000_000
    capsys.readouterr()


def test_damaged_file_is_replayed_to_the_damage(
    log: str, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = Path(log).read_bytes()
    Path(log).write_bytes(whole[: len(whole) // 2])
    assert main(["replay", log]) == 1
    assert "DAMAGED" in capsys.readouterr().out.splitlines()[-1]


def test_navigator_needs_re_execute(log: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", log, "--navigator", "bug"]) == 2
    assert "needs --re-execute" in capsys.readouterr().err


def test_re_execute_runs_in_a_process(log: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", log, "--re-execute"]) == 2
    assert "cannot be re-executed: it holds no inputs of control ticks" in capfd.readouterr().err


def test_start_is_the_time_of_the_first_frame(log: str) -> None:
    assert ReplayBus(Path(log), ManualClock()).log_index.start_ns == START_US * 1000


@pytest.mark.parametrize(("large", "frames_sent"), [(0, True), (1 << 40, False)])
def test_large_file_is_announced_before_reading(
    log: str,
    large: int,
    frames_sent: bool,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("ground.cli.observe.replay.LARGE_BYTES", large)
    assert main(["replay", log, "--json"]) == 0
    assert capsys.readouterr().err.startswith(f"reading {log}, ") is frames_sent
