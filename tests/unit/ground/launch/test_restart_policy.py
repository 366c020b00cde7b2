"""Who dies comes back, later each time, and not for ever."""

from hypothesis import given
from hypothesis import strategies as st

from ground.launch.restart_policy import RestartPolicy, RestartSchedule
from runtime.units import NS_PER_MS, NS_PER_S

ROLE = "robot r1"
KILLED = "was killed (signal SIGKILL)"


def deaths(supervisor: RestartSchedule, *at_ns: int) -> list[str]:
    return [supervisor.died(ROLE, KILLED, now_ns) for now_ns in at_ns]


def test_the_first_restart_is_at_once_and_carries_the_cause() -> None:
    supervisor = RestartSchedule([ROLE])
    (words,) = deaths(supervisor, 7)
    assert words == "the robot r1 process was killed (signal SIGKILL); it is started again"
    assert supervisor.due(7) == [(ROLE, KILLED)]
    assert supervisor.due(8) == []


def test_each_further_one_waits_twice_as_long_up_to_a_limit() -> None:
    supervisor = RestartSchedule([ROLE], RestartPolicy(limit=9))
    waited = []
    for _ in range(8):
        supervisor.died(ROLE, KILLED, 0)
        waited.append(next(ms for ms in range(0, 3000, 100) if supervisor.due(ms * NS_PER_MS)))
    assert waited == [0, 200, 400, 800, 1600, 2000, 2000, 2000]


def test_a_pause_is_told() -> None:
    supervisor = RestartSchedule([ROLE])
    assert deaths(supervisor, 0, 1)[1].endswith("it is started again in 0.2 s")


def test_the_sixth_death_within_a_minute_is_given_up_loudly_and_for_good() -> None:
    supervisor = RestartSchedule([ROLE, "plant"])
    words = deaths(supervisor, *(second * NS_PER_S for second in range(6)))
    assert words[5] == f"GIVEN UP: the robot r1 process {KILLED}, 6 times within 60 s"
    assert supervisor.given_up == {ROLE: words[5]}
    supervisor.due(5 * NS_PER_S)
    assert supervisor.due(1000 * NS_PER_S) == []


def test_after_a_quiet_minute_all_is_forgiven() -> None:
    supervisor = RestartSchedule([ROLE])
    deaths(supervisor, *(second * NS_PER_S for second in range(5)))
    (words,) = deaths(supervisor, 64 * NS_PER_S + 1)
    assert words.endswith("it is started again")
    assert not supervisor.given_up


def test_the_deaths_of_one_are_not_those_of_another() -> None:
    supervisor = RestartSchedule([ROLE, "plant"])
    deaths(supervisor, 0, 1, 2, 3, 4)
    supervisor.died("plant", "was told to stop", 5)
    assert ("plant", "was told to stop") in supervisor.due(5)
    assert not supervisor.given_up


@given(st.lists(st.integers(0, 20 * NS_PER_S), max_size=60))
def test_no_minute_has_more_restarts_than_the_limit(gaps_ns: list[int]) -> None:
    supervisor, now_ns, restarts = RestartSchedule([ROLE]), 0, []
    for gap_ns in gaps_ns:
        now_ns += gap_ns
        if supervisor.given_up:
            break
        supervisor.died(ROLE, KILLED, now_ns)
        now_ns += 2 * NS_PER_S  # the longest pause
        restarts += [now_ns for _ in supervisor.due(now_ns)]
    window_ns = 60 * NS_PER_S
    for begun_ns in restarts:
        within = [at_ns for at_ns in restarts if begun_ns <= at_ns < begun_ns + window_ns]
        assert len(within) <= 6
