from math import inf, nan

import pytest

from gateways.mavlink.coordinates import PER_DEG
from gateways.mavlink.mavlink_dialect import MavMessage
from ground.client.goal import Destination
from ground.client.operations.commands import Restart, ReturnHome
from ground.client.operations.goals import Goto
from ground.missions.qgroundcontrol import to_global
from protocol.wire.enums import Mode, Vehicle
from protocol.wire.reasons import Reason
from tests.support.each import each
from tests.support.gateway.fake_port import CLIENT, ORIGIN, OTHER, Bench
from tests.support.gateway.messages import acks, command, command_int, words
from tests.support.gateway.piloting import driving_bench, performed, show
from tests.support.gateway.telemetry import odometry

ACCEPTED, LATER, DENIED, UNSUPPORTED_FRAME, NOT_IN_CONTROL = 0, 1, 2, 9, 10
SET_HOME, GET_HOME, BANNER, RESTART = 179, 410, 42428, 246
LATITUDE_DEG, LONGITUDE_DEG = to_global(ORIGIN, 12.0, -7.0)
X, Y = round(LATITUDE_DEG * PER_DEG), round(LONGITUDE_DEG * PER_DEG)


@pytest.fixture
def bench() -> Bench:
    return driving_bench()


def homes(messages: list[MavMessage]) -> list[tuple[float, float]]:
    """Return the north and east of each HOME_POSITION."""
    return [(m.x, m.y) for m in messages if m.get_type() == "HOME_POSITION"]


def test_banner_names_version_and_robot(bench: Bench) -> None:
    sent = bench.send(command(BANNER))
    assert acks(sent) == [(BANNER, ACCEPTED)]
    assert words(sent).startswith("ArduRover V4.")
    assert "robot r1" in words(sent)


def test_home_is_sent_on_request(bench: Bench) -> None:
    sent = bench.send(command(GET_HOME))
    assert acks(sent) == [(GET_HOME, ACCEPTED)]
    assert homes(sent) == [(0.0, 0.0)]


def test_home_at_a_place(bench: Bench) -> None:
    sent = bench.send(command_int(SET_HOME, 0, x=X, y=Y))
    assert acks(sent) == [(SET_HOME, ACCEPTED)]
    assert homes(sent)[0] == pytest.approx((-7.0, 12.0), abs=0.02)
    assert homes(bench.send(command(GET_HOME)))[0] == pytest.approx((-7.0, 12.0), abs=0.02)


def test_home_where_the_robot_is(bench: Bench) -> None:
    assert homes(bench.send(command(SET_HOME, 1))) == [(4.0, 3.0)]


def test_home_where_an_unplaced_robot_is_is_denied(bench: Bench) -> None:
    bench.port.telemetry["odometry"] = odometry(cov_xx_m2=nan)
    bench.after(0.02)
    assert acks(bench.send(command(SET_HOME, 1))) == [(SET_HOME, DENIED)]


@pytest.mark.parametrize("value", [0.0, nan, inf, 1e30, -90.0])
def test_home_at_no_place_is_denied(bench: Bench, value: float) -> None:
    sent = bench.send(command(SET_HOME, 0, 0, 0, 0, value, value, 0))
    assert acks(sent) == [(SET_HOME, DENIED)]
    assert homes(bench.send(command(GET_HOME))) == [(0.0, 0.0)]


def test_home_in_a_local_frame_is_refused(bench: Bench) -> None:
    sent = bench.send(command_int(SET_HOME, 0, x=X, y=Y, frame=1))
    assert acks(sent) == [(SET_HOME, UNSUPPORTED_FRAME)]


def test_home_of_another_client_is_refused(bench: Bench) -> None:
    bench.vehicle.control.ensure(CLIENT, lambda _: None)
    sent = bench.send(command_int(SET_HOME, 0, x=X, y=Y), OTHER)
    assert acks(sent) == [(SET_HOME, NOT_IN_CONTROL)]


def test_rtl_drives_to_a_chosen_home(bench: Bench) -> None:
    bench.send(command(SET_HOME, 1))
    bench.send(command(176, 1, 11))
    home = Destination(x_m=3.0, y_m=4.0, heading_rad=None)
    assert performed(bench) == [Goto(goal=home, wait=False, arms=False)]
    bench.port.answer()
    show(bench, Mode.AUTO)
    assert bench.vehicle.modes.number == 11
    bench.send(command(176, 1, 12))
    assert performed(bench) == [ReturnHome()]


def test_restart_of_a_disarmed_robot() -> None:
    bench = driving_bench(vehicle=Vehicle.STANDBY)
    bench.send(command(RESTART, 1))
    assert performed(bench) == [Restart()]
    bench.port.answer()
    assert acks(bench.sent()) == [(RESTART, ACCEPTED)]


def test_restart_of_an_armed_robot_is_denied(bench: Bench) -> None:
    sent = bench.send(command(RESTART, 1))
    assert acks(sent) == [(RESTART, DENIED)]
    assert "disarm first" in words(sent)
    assert performed(bench) == []


def test_restart_that_the_robot_refuses_is_denied() -> None:
    bench = driving_bench(vehicle=Vehicle.STANDBY)
    bench.send(command(RESTART, 1))
    bench.port.refuse(Reason.ARMED)
    assert acks(bench.sent()) == [(RESTART, DENIED)]


@each("action", [0.0, 2.0, 3.0, nan, inf, 65535.0])
def test_other_actions_than_a_restart_are_denied(action: float) -> None:
    bench = driving_bench(vehicle=Vehicle.STANDBY)
    assert acks(bench.send(command(RESTART, action))) == [(RESTART, DENIED)]
    assert performed(bench) == []


def test_restart_of_a_silent_robot_is_rejected() -> None:
    bench = driving_bench()
    bench.port.telemetry.clear()
    bench.after(0.02)
    assert acks(bench.send(command(RESTART, 1))) == [(RESTART, LATER)]
