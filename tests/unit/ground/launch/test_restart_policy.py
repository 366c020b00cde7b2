"""Restarts come later each time and end after a limit."""

from hypothesis import given
from hypothesis import strategies as st

from ground.launch.restart_policy import RestartPolicy, RestartSchedule
from runtime.units import NS_PER_MS, NS_PER_S

ROLE = "robot r1"
KILLED = "was killed (signal SIGKILL)"


def exits(schedule: RestartSchedule, *at_ns: int) -> list[str]:
    return [schedule.record_exit(ROLE, KILLED, now_ns) for now_ns in at_ns]


def test_first_restart_is_immediate() -> None:
    schedule = RestartSchedule([ROLE])
    (words,) = exits(schedule, 7)
    assert words == "the robot r1 process was killed (signal SIGKILL); restarting"
    assert schedule.due(7) == [(ROLE, KILLED)]
    assert schedule.due(8) == []


def test_restart_delay_doubles_up_to_a_limit() -> None:
    schedule = RestartSchedule([ROLE], RestartPolicy(limit=9))
    waited = []
    for _ in range(8):
        schedule.record_exit(ROLE, KILLED, 0)
        waited.append(next(ms for ms in range(0, 3000, 100) if schedule.due(ms * NS_PER_MS)))
    assert waited == [0, 200, 400, 800, 1600, 2000, 2000, 2000]


def test_message_names_the_restart_delay() -> None:
    schedule = RestartSchedule([ROLE])
    assert exits(schedule, 0, 1)[1].endswith("restarting in 0.2 s")


def test_sixth_exit_within_a_minute_is_final() -> None:
    schedule = RestartSchedule([ROLE, "plant"])
    words = exits(schedule, *(second * NS_PER_S for second in range(6)))
    assert (
        words[5]
        == f"GIVEN UP: the robot r1 process {KILLED}, 6 times within 60 s; it stays stopped"
    )
    assert schedule.given_up == {ROLE: words[5]}
    schedule.due(5 * NS_PER_S)
    assert schedule.due(1000 * NS_PER_S) == []


def test_old_exits_do_not_count() -> None:
    schedule = RestartSchedule([ROLE])
    exits(schedule, *(second * NS_PER_S for second in range(5)))
    (words,) = exits(schedule, 64 * NS_PER_S + 1)
    assert words.endswith("restarting")
    assert not schedule.given_up


def test_exits_count_per_role() -> None:
    schedule = RestartSchedule([ROLE, "plant"])
    exits(schedule, 0, 1, 2, 3, 4)
    schedule.record_exit("plant", "was stopped", 5)
    assert ("plant", "was stopped") in schedule.due(5)
    assert not schedule.given_up


@given(st.lists(st.integers(0, 20 * NS_PER_S), max_size=60))
def test_no_minute_has_more_restarts_than_the_limit(gaps_ns: list[int]) -> None:
    schedule, now_ns, restarts = RestartSchedule([ROLE]), 0, []
    for gap_ns in gaps_ns:
        now_ns += gap_ns
        if schedule.given_up:
            break
        schedule.record_exit(ROLE, KILLED, now_ns)
        now_ns += 2 * NS_PER_S  # the longest pause
        restarts += [now_ns for _ in schedule.due(now_ns)]
    window_ns = 60 * NS_PER_S
    for begun_ns in restarts:
        within = [at_ns for at_ns in restarts if begun_ns <= at_ns < begun_ns + window_ns]
        assert len(within) <= 6
