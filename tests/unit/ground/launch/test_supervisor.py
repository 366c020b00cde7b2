"""The supervisor: exited and hung processes are reported and restarted, up to a limit."""

import signal
from collections.abc import Sequence

from hypothesis import given
from hypothesis import strategies as st

from ground.launch.child_processes import ChildExit, Children
from ground.launch.supervisor import (
    PACED_SILENT_NS,
    RESTART_WAIT_NS,
    ROUTER,
    SETTLED_NS,
    SILENT_NS,
    SLOW_NS,
    STARTING_NS,
    HangDetector,
    RestartPolicy,
    RestartSchedule,
    Supervisor,
)
from runtime.clock import ManualClock
from runtime.units import NS_PER_MS, NS_PER_S
from tests.support.each import each

ROLE = "robot r1"
KILLED_REASON = "was killed (signal SIGKILL)"


def exits(schedule: RestartSchedule, *at_ns: int) -> list[str]:
    return [schedule.record_exit(ROLE, KILLED_REASON, now_ns) for now_ns in at_ns]


def test_first_restart_is_immediate() -> None:
    schedule = RestartSchedule([ROLE])
    (words,) = exits(schedule, 7)
    assert words == "the robot r1 process was killed (signal SIGKILL); restarting"
    assert schedule.due(7) == [(ROLE, KILLED_REASON)]
    assert schedule.due(8) == []


def test_restart_delay_doubles_up_to_a_limit() -> None:
    schedule = RestartSchedule([ROLE], RestartPolicy(limit=9))
    waited = []
    for _ in range(8):
        schedule.record_exit(ROLE, KILLED_REASON, 0)
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
        == f"GIVEN UP: the robot r1 process {KILLED_REASON}, 6 times within 60 s; it stays stopped"
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
        schedule.record_exit(ROLE, KILLED_REASON, now_ns)
        now_ns += 2 * NS_PER_S  # the longest pause
        restarts += [now_ns for _ in schedule.due(now_ns)]
    window_ns = 60 * NS_PER_S
    for begun_ns in restarts:
        within = [at_ns for at_ns in restarts if begun_ns <= at_ns < begun_ns + window_ns]
        assert len(within) <= 6


ROBOT = "robot r1"
PLANT = "plant"
NEEDED = (ROBOT, PLANT)
KILLED = "the robot r1 process was killed (signal SIGKILL)"


class SimulatedChildren(Children):
    """Simulated processes that end when they are killed."""

    def __init__(self) -> None:
        super().__init__(ManualClock())
        self.running = {ROBOT, PLANT}
        self.started: list[tuple[str, list[str]]] = []
        self.exits: list[ChildExit] = []

    def start(self, role: str, arguments: Sequence[str]) -> None:
        self.running.add(role)
        self.started.append((role, list(arguments)))

    def take_exited(self) -> list[ChildExit]:
        exits, self.exits = self.exits, []
        return exits

    def send(self, role: str, number: int) -> bool:
        if role not in self.running:
            return False
        self.running.remove(role)
        self.exits.append(ChildExit(role, -number, "output"))
        return True


class Stage:
    """A supervisor with its processes; each sent a message at time 0."""

    def __init__(
        self, *, detector: bool = True, limit: int = 5, silent_ns: int = SILENT_NS
    ) -> None:
        self.children = SimulatedChildren()
        self.detector = HangDetector(ROBOT, [ROBOT, PLANT], lambda: True, -NS_PER_S, silent_ns)
        for role in (ROBOT, PLANT):
            self.detector.note_message(role, 0)
        self.supervisor = Supervisor(
            self.children,
            RestartSchedule([ROBOT, PLANT], RestartPolicy(limit=limit)),
            self.detector if detector else None,
            lambda role, cause: [role, cause],
        )

    def wait(self, now_ns: int) -> None:
        """Run rounds until then."""
        for at_ns in (*range(0, now_ns, NS_PER_S // 10), now_ns):
            self.supervisor.round(at_ns)

    def kill(self, role: str, now_ns: int) -> None:
        self.children.send(role, signal.SIGKILL)
        self.supervisor.round(now_ns)


def test_killed_process_is_restarted_and_reported_once() -> None:
    stage = Stage()
    stage.kill(ROBOT, 5)
    assert stage.children.started == [(ROBOT, [ROBOT, "was killed (signal SIGKILL)"])]
    assert stage.supervisor.next_event() == f"{KILLED}; restarting"
    assert stage.supervisor.next_event() == ""


def test_silent_process_is_killed_as_hung() -> None:
    stage = Stage()
    stage.wait(SILENT_NS + 1)
    assert stage.children.started == [(ROBOT, [ROBOT, "hung (silent for 2.5 s)"])]
    assert "hung (silent for 2.5 s)" in stage.supervisor.next_event()


def test_suspended_process_in_paced_time_is_not_killed_within_four_seconds() -> None:
    stage = Stage(silent_ns=PACED_SILENT_NS)
    stage.wait(PACED_SILENT_NS)
    assert stage.children.started == []
    stage.supervisor.round(PACED_SILENT_NS + 1)
    assert stage.children.started == [(ROBOT, [ROBOT, "hung (silent for 4.5 s)"])]


def test_suspended_gateway_is_killed_though_it_sends_once_a_second() -> None:
    detector = HangDetector(ROBOT, [ROBOT], lambda: True, -NS_PER_S, slow=["gateway"])
    for at_ns in range(0, 10 * NS_PER_S + 1, NS_PER_S // 10):
        detector.note_message(ROBOT, at_ns)
        if at_ns % NS_PER_S == 0 and at_ns <= 2 * NS_PER_S:
            detector.note_message("gateway", at_ns)
        is_overdue = at_ns > 2 * NS_PER_S + SILENT_NS + SLOW_NS
        if detector.silent(at_ns):
            assert is_overdue
            break
    else:
        raise AssertionError("not detected")
    detector.note_message("another role", 0)
    assert detector.silent(10 * NS_PER_S) == []


def test_dead_process_in_paced_time_is_restarted_at_once() -> None:
    stage = Stage(silent_ns=PACED_SILENT_NS)
    stage.kill(ROBOT, 5)
    assert stage.children.started == [(ROBOT, [ROBOT, "was killed (signal SIGKILL)"])]


def test_without_a_detector_no_hang_is_detected() -> None:
    stage = Stage(detector=False)
    stage.supervisor.round(100 * NS_PER_S)
    assert stage.children.started == []
    stage.kill(ROBOT, 100 * NS_PER_S)
    assert len(stage.children.started) == 1


def test_given_up_process_is_not_restarted() -> None:
    stage = Stage(limit=0)
    stage.kill(ROBOT, 0)
    stage.supervisor.round(100 * NS_PER_S)
    assert stage.children.started == []
    assert stage.supervisor.next_event().startswith("GIVEN UP")
    void = stage.supervisor.void(NEEDED, 0)
    assert void is not None
    assert void == (f"{KILLED} and is given up", True)


def test_trial_is_void_only_by_its_own_processes() -> None:
    stage = Stage()
    assert stage.supervisor.void(NEEDED, 0) is None
    stage.kill(PLANT, 0)
    assert stage.supervisor.void((ROBOT,), 0) is None
    assert stage.supervisor.void(NEEDED, 0) is not None


@each("back", [True, False])
def test_void_run_is_final_after_a_wait(back: bool) -> None:
    stage = Stage()
    stage.kill(ROBOT, 0)
    if back:
        stage.detector.note_message(ROBOT, NS_PER_S)
    void = stage.supervisor.void(NEEDED, SETTLED_NS + 1)
    assert void is not None
    assert void.is_final is back
    assert ("it is back" in void.why) is back
    void = stage.supervisor.void(NEEDED, RESTART_WAIT_NS + 1)
    assert void is not None
    assert void.is_final


class Link:
    """A link that is up or down."""

    def __init__(self) -> None:
        self.is_up = True

    def __call__(self) -> bool:
        return self.is_up


class Watched(HangDetector):
    """A detector that is polled ten times a second."""

    def until(self, now_ns: int, *beating: str) -> list[str]:
        """Return the roles reported until then, while `beating` keep sending."""
        found = []
        for at_ns in (*range(self._last_check_ns, now_ns, 100 * NS_PER_MS), now_ns):
            for role in beating:
                self.note_message(role, at_ns)
            found += self.silent(at_ns)
        return found


def detector_of(hub: str, link: Link | None = None) -> Watched:
    """Return a detector whose roles all sent a message at one second."""
    detector = Watched(hub, [ROBOT, PLANT], link or Link(), NS_PER_S - 200 * NS_PER_MS)
    for role in (ROBOT, PLANT):
        detector.note_message(role, NS_PER_S)
    return detector


QUIET_NS = NS_PER_S + SILENT_NS


def test_process_with_messages_is_not_silent() -> None:
    detector = detector_of(ROBOT)
    assert detector.until(QUIET_NS) == []
    assert detector.until(60 * NS_PER_S, ROBOT, PLANT) == []


def test_silent_plant_is_reported_once() -> None:
    assert detector_of(ROBOT).until(60 * NS_PER_S, ROBOT) == [PLANT]


def test_silence_of_all_is_attributed_to_the_hub() -> None:
    assert detector_of(ROBOT).until(QUIET_NS + 1) == [ROBOT]


def test_router_without_link_is_reported() -> None:
    link = Link()
    link.is_up = False
    detector = detector_of(ROUTER, link)
    assert detector.until(QUIET_NS) == []
    assert detector.until(QUIET_NS + 1) == [ROUTER]


def test_silent_robot_behind_a_router_is_reported() -> None:
    assert detector_of(ROUTER).until(QUIET_NS + 1, PLANT) == [ROBOT]


def test_hub_restart_grants_time_to_reconnect() -> None:
    detector = detector_of(ROBOT)
    detector.note_exit(ROBOT)
    assert detector.until(60 * NS_PER_S) == []
    detector.note_start(ROBOT, 60 * NS_PER_S)
    assert detector.until(60 * NS_PER_S + STARTING_NS) == []
    assert detector.until(60 * NS_PER_S + STARTING_NS + 1, ROBOT) == [PLANT]


def test_started_process_has_limited_time_to_report() -> None:
    detector = detector_of(ROBOT)
    detector.note_exit(PLANT)
    detector.note_start(PLANT, 2 * NS_PER_S)
    assert detector.until(2 * NS_PER_S + STARTING_NS, ROBOT) == []
    assert detector.until(2 * NS_PER_S + STARTING_NS + 1, ROBOT) == [PLANT]


def test_own_suspension_restarts_the_silence() -> None:
    detector = detector_of(ROBOT)
    assert detector.silent(30 * NS_PER_S) == []
    assert detector.until(30 * NS_PER_S + SILENT_NS) == []
    assert detector.until(30 * NS_PER_S + SILENT_NS + 1) == [ROBOT]


def test_stale_message_is_no_sign_of_life() -> None:
    detector = detector_of(ROBOT)
    detector.note_exit(ROBOT)
    detector.note_message(ROBOT, 2 * NS_PER_S)
    assert detector.last_message_ns(ROBOT) is None
    detector.note_start(ROBOT, 2 * NS_PER_S)
    detector.note_message(ROBOT, 2 * NS_PER_S + NS_PER_MS)
    assert detector.last_message_ns(ROBOT) is None
    detector.note_message(ROBOT, 3 * NS_PER_S)
    assert detector.last_message_ns(ROBOT) == 3 * NS_PER_S


def test_silence_of_a_starved_process_is_not_a_hang() -> None:
    queued = {"main": 0}
    detector = Watched(
        ROBOT, [ROBOT], lambda: True, NS_PER_S - 200 * NS_PER_MS, queued_ns=lambda _: dict(queued)
    )
    detector.note_message(ROBOT, NS_PER_S)
    for _ in range(40):  # 4 s, of which it waits 3 s for a processor
        queued["main"] += 75 * NS_PER_MS
        assert detector.until(detector._last_check_ns + 100 * NS_PER_MS) == []
    assert detector.until(NS_PER_S + SILENT_NS + 3 * NS_PER_S) == [ROBOT]


def test_wait_for_a_processor_before_a_message_is_no_excuse() -> None:
    queued = {"main": 100 * NS_PER_S}
    detector = Watched(
        ROBOT, [ROBOT], lambda: True, NS_PER_S - 200 * NS_PER_MS, queued_ns=lambda _: queued
    )
    detector.note_message(ROBOT, NS_PER_S)
    assert detector.until(QUIET_NS + 1) == [ROBOT]


def test_hang_of_a_process_whose_other_threads_wait_is_found() -> None:
    queued = {"main": 0}
    detector = Watched(
        ROBOT, [ROBOT], lambda: True, NS_PER_S - 200 * NS_PER_MS, queued_ns=lambda _: dict(queued)
    )
    detector.note_message(ROBOT, NS_PER_S)
    ended: list[str] = []
    while not ended and detector._last_check_ns < NS_PER_S + 6 * SILENT_NS:
        queued["main"] += 100 * NS_PER_MS
        ended = detector.until(detector._last_check_ns + 100 * NS_PER_MS)
    assert ended == [ROBOT]
    assert detector._last_check_ns >= NS_PER_S + 5 * SILENT_NS
