"""What is shown is live or said to be old; never an old number as if it were new."""

from collections.abc import Callable
from math import inf, nan
from typing import Any

import pytest

from ground.operator import Pace
from ground.status_line import ages, goal_line, metres, state_of, watch_line
from ground.telemetry import Age, Telemetry, age_of
from protocol.codec import Encoder
from protocol.enums import GoalState, Mode, Navigator, Vehicle
from protocol.mailbox import Mailbox, Sample
from protocol.message import Message
from protocol.messages import NavigatorStatus, PlanarOdometry
from protocol.reasons import Reason
from protocol.topics import ENCODING, HEARTBEAT, ODOMETRY, STATUS, TEXT, Topic

MS = 1_000_000


class Air:
    """Mailboxes that a test fills."""

    def __init__(self) -> None:
        self.boxes: dict[str, Mailbox[Any]] = {}
        self._encoder = Encoder(1, 1)

    def mailbox(
        self,
        topic: Topic[Any],
        robot: str | None = None,
        notify: Callable[[int], None] | None = None,
    ) -> Mailbox[Any]:
        return self.boxes.setdefault(topic.path, Mailbox(topic, notify))

    def put(self, topic: Topic[Any], message: Message, at_ns: int) -> None:
        self.boxes[topic.path].store(Sample(ENCODING, self._encoder.encode(message)), at_ns)


def status(goal: int = GoalState.DRIVING, vehicle: int = Vehicle.ACTIVE) -> NavigatorStatus:
    return NavigatorStatus(
        time_ns=1,
        goal_started_ns=0,
        goal_ended_ns=0,
        goal_id=1,
        goal_x_m=1.0,
        goal_y_m=0.0,
        goal_heading_rad=0.0,
        goal_distance_m=3.25,
        vehicle=vehicle,
        mode=Mode.GUIDED,
        goal=goal,
        vehicle_reason=0,
        goal_reason=Reason.BLOCKED,
        navigator=Navigator.VGM,
        side=1,
    )


ODOMETRY_NOW = PlanarOdometry(
    time_ns=1,
    x_m=1.0,
    y_m=2.0,
    heading_rad=1.0,
    speed_m_s=0.25,
    yaw_rate_rad_s=0.0,
    cov_xx_m2=0.0,
    cov_xy_m2=0.0,
    cov_xh_m_rad=0.0,
    cov_yy_m2=0.0,
    cov_yh_m_rad=0.0,
    cov_hh_rad2=0.0,
)


@pytest.fixture
def air() -> Air:
    return Air()


@pytest.fixture
def telemetry(air: Air) -> Telemetry:
    return Telemetry(air, "r1")


def test_the_goal_line_has_distance_state_reason_and_speed(air: Air, telemetry: Telemetry) -> None:
    air.put(STATUS, status(), 0)
    air.put(ODOMETRY, ODOMETRY_NOW, 0)
    assert goal_line(telemetry, 10 * MS, 0) == (
        "3.25 m to go  ACTIVE GUIDED DRIVING  (has not moved although it tries to)  0.25 m/s"
    )


def test_an_old_number_is_not_shown(air: Air, telemetry: Telemetry) -> None:
    air.put(STATUS, status(), 0)
    air.put(ODOMETRY, ODOMETRY_NOW, 0)
    late = watch_line(telemetry, 2_000 * MS)
    assert "3.25" not in late
    assert "pose --" in late
    assert "status 2.0 s" in late
    assert "heartbeat --" in late


def test_silence_is_said_with_its_length(telemetry: Telemetry) -> None:
    assert goal_line(telemetry, 0, 1_500 * MS) == "nothing heard of the robot for 1.5 s"
    assert goal_line(telemetry, 0, 0) == "waiting for the robot's status"


def test_live_streams_are_not_listed(air: Air) -> None:
    telemetry = Telemetry(air, "r1")
    air.put(STATUS, status(), 0)
    assert "status" not in ages(telemetry, 40 * MS)
    assert "status 0.2 s" in ages(telemetry, 200 * MS)


def test_a_stream_fades_and_an_event_stays() -> None:
    assert age_of(STATUS, 60 * MS) is Age.LIVE
    assert age_of(STATUS, 130 * MS) is Age.DIM
    assert age_of(STATUS, 260 * MS) is Age.GONE
    assert age_of(HEARTBEAT, 400 * MS) is Age.LIVE
    assert age_of(TEXT, 10**15) is Age.LIVE


def test_seen_tells_message_age_and_trust(air: Air, telemetry: Telemetry) -> None:
    assert telemetry.seen(STATUS, 5).age is Age.GONE
    assert telemetry.fresh(STATUS, 5) is None
    air.put(STATUS, status(), 0)
    seen = telemetry.seen(STATUS, 130 * MS)
    assert (seen.message, seen.age_ns, seen.age) == (status(), 130 * MS, Age.DIM)
    assert telemetry.fresh(STATUS, 130 * MS) == status()


def test_states_of_a_newer_robot_are_shown_as_numbers() -> None:
    assert state_of(status(goal=99, vehicle=77)) == "Vehicle 77 GUIDED GoalState 99"


def test_no_number_is_missing_and_infinity_is_no_echo() -> None:
    assert (metres(nan), metres(inf), metres(0.5)) == ("--", "none", "0.50 m")


def test_a_beat_is_due_at_once_and_then_by_the_faster_clock() -> None:
    pace = Pace()
    assert pace.due(0, 0)
    assert not pace.due(199 * MS, 0)
    assert pace.due(200 * MS, 0)
    assert not pace.due(201 * MS, 199 * MS)
    assert pace.due(202 * MS, 400 * MS)
