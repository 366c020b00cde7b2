"""Exited and hung processes are restarted, reported, and void the trials that need them."""

import signal
from collections.abc import Sequence

from ground.launch.child_processes import ChildExit, Children
from ground.launch.hang_detector import PACED_SILENT_NS, SILENT_NS, SLOW_NS, HangDetector
from ground.launch.restart_policy import RestartPolicy, RestartSchedule
from ground.launch.supervisor import RESTART_WAIT_NS, SETTLED_NS, Supervisor
from runtime.clock import ManualClock
from tests.support.each import each

ROBOT, PLANT = "robot r1", "plant"
NEEDED = (ROBOT, PLANT)
SECOND = 1_000_000_000
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
        self.detector = HangDetector(ROBOT, [ROBOT, PLANT], lambda: True, -SECOND, silent_ns)
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
        for at_ns in (*range(0, now_ns, SECOND // 10), now_ns):
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
    detector = HangDetector(ROBOT, [ROBOT], lambda: True, -SECOND, slow=["gateway"])
    for at_ns in range(0, 10 * SECOND + 1, SECOND // 10):
        detector.note_message(ROBOT, at_ns)
        if at_ns % SECOND == 0 and at_ns <= 2 * SECOND:
            detector.note_message("gateway", at_ns)
        is_overdue = at_ns > 2 * SECOND + SILENT_NS + SLOW_NS
        if detector.silent(at_ns):
            assert is_overdue
            break
    else:
        raise AssertionError("not detected")
    detector.note_message("another role", 0)
    assert detector.silent(10 * SECOND) == []


def test_dead_process_in_paced_time_is_restarted_at_once() -> None:
    stage = Stage(silent_ns=PACED_SILENT_NS)
    stage.kill(ROBOT, 5)
    assert stage.children.started == [(ROBOT, [ROBOT, "was killed (signal SIGKILL)"])]


def test_without_a_detector_no_hang_is_detected() -> None:
    stage = Stage(detector=False)
    stage.supervisor.round(100 * SECOND)
    assert stage.children.started == []
    stage.kill(ROBOT, 100 * SECOND)
    assert len(stage.children.started) == 1


def test_given_up_process_is_not_restarted() -> None:
    stage = Stage(limit=0)
    stage.kill(ROBOT, 0)
    stage.supervisor.round(100 * SECOND)
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
        stage.detector.note_message(ROBOT, SECOND)
    void = stage.supervisor.void(NEEDED, SETTLED_NS + 1)
    assert void is not None
    assert void.is_final is back
    assert ("it is back" in void.why) is back
    void = stage.supervisor.void(NEEDED, RESTART_WAIT_NS + 1)
    assert void is not None
    assert void.is_final
