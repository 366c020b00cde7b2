"""A silent process is reported as hung, unless its hub explains the silence."""

from ground.launch.hang_detector import ROUTER, SILENT_NS, STARTING_NS, HangDetector

ROBOT, PLANT = "robot r1", "plant"
MS = 1_000_000
SECOND = 1000 * MS


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
        for at_ns in (*range(self._last_check_ns, now_ns, 100 * MS), now_ns):
            for role in beating:
                self.note_message(role, at_ns)
            found += self.silent(at_ns)
        return found


def detector_of(hub: str, link: Link | None = None) -> Watched:
    """Return a detector whose roles all sent a message at one second."""
    detector = Watched(hub, [ROBOT, PLANT], link or Link(), SECOND - 200 * MS)
    for role in (ROBOT, PLANT):
        detector.note_message(role, SECOND)
    return detector


QUIET_NS = SECOND + SILENT_NS


def test_process_with_messages_is_not_silent() -> None:
    detector = detector_of(ROBOT)
    assert detector.until(QUIET_NS) == []
    assert detector.until(60 * SECOND, ROBOT, PLANT) == []


def test_silent_plant_is_reported_once() -> None:
    assert detector_of(ROBOT).until(60 * SECOND, ROBOT) == [PLANT]


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
    assert detector.until(60 * SECOND) == []
    detector.note_start(ROBOT, 60 * SECOND)
    assert detector.until(60 * SECOND + STARTING_NS) == []
    assert detector.until(60 * SECOND + STARTING_NS + 1, ROBOT) == [PLANT]


def test_started_process_has_limited_time_to_report() -> None:
    detector = detector_of(ROBOT)
    detector.note_exit(PLANT)
    detector.note_start(PLANT, 2 * SECOND)
    assert detector.until(2 * SECOND + STARTING_NS, ROBOT) == []
    assert detector.until(2 * SECOND + STARTING_NS + 1, ROBOT) == [PLANT]


def test_own_suspension_restarts_the_silence() -> None:
    detector = detector_of(ROBOT)
    assert detector.silent(30 * SECOND) == []
    assert detector.until(30 * SECOND + SILENT_NS) == []
    assert detector.until(30 * SECOND + SILENT_NS + 1) == [ROBOT]


def test_stale_message_is_no_sign_of_life() -> None:
    detector = detector_of(ROBOT)
    detector.note_exit(ROBOT)
    detector.note_message(ROBOT, 2 * SECOND)
    assert detector.last_message_ns(ROBOT) is None
    detector.note_start(ROBOT, 2 * SECOND)
    detector.note_message(ROBOT, 2 * SECOND + MS)
    assert detector.last_message_ns(ROBOT) is None
    detector.note_message(ROBOT, 3 * SECOND)
    assert detector.last_message_ns(ROBOT) == 3 * SECOND


def test_silence_of_a_starved_process_is_not_a_hang() -> None:
    queued = {"main": 0}
    detector = Watched(
        ROBOT, [ROBOT], lambda: True, SECOND - 200 * MS, queued_ns=lambda _: dict(queued)
    )
    detector.note_message(ROBOT, SECOND)
    for _ in range(40):  # 4 s, of which it waits 3 s for a processor
        queued["main"] += 75 * MS
        assert detector.until(detector._last_check_ns + 100 * MS) == []
    assert detector.until(SECOND + SILENT_NS + 3 * SECOND) == [ROBOT]


def test_wait_for_a_processor_before_a_message_is_no_excuse() -> None:
    queued = {"main": 100 * SECOND}
    detector = Watched(ROBOT, [ROBOT], lambda: True, SECOND - 200 * MS, queued_ns=lambda _: queued)
    detector.note_message(ROBOT, SECOND)
    assert detector.until(QUIET_NS + 1) == [ROBOT]


def test_hang_of_a_process_whose_other_threads_wait_is_found() -> None:
    queued = {"main": 0}
    detector = Watched(
        ROBOT, [ROBOT], lambda: True, SECOND - 200 * MS, queued_ns=lambda _: dict(queued)
    )
    detector.note_message(ROBOT, SECOND)
    ended: list[str] = []
    while not ended and detector._last_check_ns < SECOND + 6 * SILENT_NS:
        queued["main"] += 100 * MS
        ended = detector.until(detector._last_check_ns + 100 * MS)
    assert ended == [ROBOT]
    assert detector._last_check_ns >= SECOND + 5 * SILENT_NS
