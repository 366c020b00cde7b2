"""Streams: rates, requests, silence of the bus, the origin, TIMESYNC and PING."""

from collections import Counter, deque
from math import inf, nan

import pytest

from checks.harness.messages import make
from gateways.mavlink import ardupilot
from gateways.mavlink.commands.vehicle_commands import SET_GLOBAL_ORIGIN
from gateways.mavlink.coordinates import GlobalPlace, home_at, local_at
from gateways.mavlink.liveness import ClockSync, RobotTexts, SilenceTexts
from gateways.mavlink.mav_service import COMPONENT, WATCHER
from gateways.mavlink.mav_vehicle import MavVehicle, MessageSource
from gateways.mavlink.mavlink_dialect import (
    AvailableModes,
    ComponentMetadata,
    CurrentMode,
    MavMessage,
    TimeSync,
    mavlink,
)
from gateways.mavlink.motion.setpoints import place_goal
from gateways.mavlink.services import face_of
from gateways.mavlink.streams import STREAMS, StreamScheduler
from gateways.mavlink.telemetry_messages import global_position
from ground.commands.param import ShowParameters
from protocol.wire.enums import GoalState, MissionState, Mode, Severity, Vehicle
from protocol.wire.messages import LeaseStatus, NavigatorStatus, Statustext
from protocol.wire.reasons import Reason
from protocol.wire.statustext import pieces_of
from tests.support.each import each
from tests.support.gateway.benches import robot_table
from tests.support.gateway.fake_port import (
    CLIENT,
    ORIGIN,
    OTHER,
    Bench,
    acks,
    command,
    everything,
    mission_status,
    status,
    words,
)

SLOW_BYTES_S = 4500
EVERY = mavlink.MAV_DATA_STREAM_ALL


class Rates:
    """A bench that counts what each client gets in some seconds."""

    def __init__(self, *, line_bytes_s: int | None = None) -> None:
        self.bench = Bench(self._scheduler)
        self.bench.port.telemetry = everything()
        self.bench.face.join(CLIENT.client, line_bytes_s)
        self.bench.face.join(OTHER.client)

    def _scheduler(self, vehicle: MavVehicle) -> StreamScheduler:
        self.scheduler = StreamScheduler(vehicle)
        return self.scheduler

    def count(self, seconds: int, client: int = CLIENT.client) -> Counter[str]:
        found: Counter[str] = Counter()
        for _ in range(50 * seconds):
            self.bench.now_ns += 20_000_000
            self.bench.due()
            found.update(message.get_type() for message in self.bench.sent(client))
        return found

    def request_group(self, group: int, rate_hz: int, start: int = 1) -> None:
        message = mavlink.MAVLink_request_data_stream_message(1, 1, group, rate_hz, start)
        self.bench.send(message)

    def set(self, number: int, interval_us: int) -> bool:
        now_ns = self.bench.now_ns
        return self.scheduler.set_interval(CLIENT.client, number, interval_us, now_ns)


def test_default_rates_are_those_of_the_list() -> None:
    found = Rates().count(10)
    assert found["GLOBAL_POSITION_INT"] == found["LOCAL_POSITION_NED"] == found["ATTITUDE"] == 100
    assert found["DISTANCE_SENSOR"] == 5 * 50
    assert found["OBSTACLE_DISTANCE"] == found["ODOMETRY"] == 50
    assert found["LOCAL_POSITION_NED_COV"] == 50
    assert found["SYS_STATUS"] == found["RANGEFINDER"] == found["VFR_HUD"] == 20
    for name in ("HOME_POSITION", "BATTERY_STATUS", "GPS_RAW_INT", "EKF_STATUS_REPORT"):
        assert found[name] == 10
    assert found["WHEEL_DISTANCE"] == 0


def test_streams_begin_within_half_a_second() -> None:
    rates = Rates()
    found = {one.get_type() for one in rates.bench.after(0.5)}
    assert {"SYS_STATUS", "GLOBAL_POSITION_INT", "HOME_POSITION", "GPS_RAW_INT"} <= found


def test_interval_of_one_client_leaves_the_other() -> None:
    rates = Rates()
    assert rates.set(mavlink.MAVLINK_MSG_ID_ATTITUDE, 50_000)
    assert rates.set(mavlink.MAVLINK_MSG_ID_VFR_HUD, -1)
    found = rates.count(2)
    assert found["ATTITUDE"] == pytest.approx(40, abs=1)
    assert found["VFR_HUD"] == 0
    other = rates.count(2, OTHER.client)
    assert (other["ATTITUDE"], other["VFR_HUD"]) == (20, 4)


def test_interval_0_returns_to_the_default() -> None:
    rates = Rates()
    rates.set(mavlink.MAVLINK_MSG_ID_ATTITUDE, -1)
    rates.set(mavlink.MAVLINK_MSG_ID_ATTITUDE, 0)
    assert rates.count(2)["ATTITUDE"] == 20


def test_message_without_a_default_rate_can_be_asked_for() -> None:
    rates = Rates()
    rates.set(mavlink.MAVLINK_MSG_ID_WHEEL_DISTANCE, 500_000)
    assert rates.count(2)["WHEEL_DISTANCE"] == pytest.approx(4, abs=1)


def test_no_interval_is_shorter_than_a_round() -> None:
    rates = Rates()
    rates.set(mavlink.MAVLINK_MSG_ID_ATTITUDE, 1)
    assert rates.count(1)["ATTITUDE"] == pytest.approx(20, abs=1)
    number = mavlink.MAVLINK_MSG_ID_ATTITUDE
    assert rates.scheduler.interval_us(CLIENT.client, number, rates.bench.now_ns) == 50_000


def test_unknown_message_has_no_interval() -> None:
    rates = Rates()
    assert not rates.set(11_000, 1000)
    assert rates.scheduler.interval_us(CLIENT.client, 11_000, 0) == 0


@each("group", [1, 2, 6, 10, 11, 12])
def test_each_group_changes_its_messages_and_no_others(group: int) -> None:
    rates = Rates()
    members = {one.number for one in rates.bench.vehicle.catalogue if one.group == group}
    names = {mavlink.mavlink_map[number].msgname for number in members}
    before = rates.count(2)
    rates.request_group(group, 3)
    after = rates.count(2)
    assert names
    for name in after:
        copies = 5 if name == "DISTANCE_SENSOR" else 1
        expected = 6 * copies if name in names else before[name]
        assert after[name] == pytest.approx(expected, abs=copies)


def test_all_groups_start_and_stop_together() -> None:
    rates = Rates()
    rates.request_group(EVERY, 4)
    found = rates.count(2)
    for name in ("SYS_STATUS", "GLOBAL_POSITION_INT", "VFR_HUD"):
        assert found[name] == pytest.approx(8, abs=1)
    rates.request_group(EVERY, 4, start=0)
    found = rates.count(2)
    assert found["SYS_STATUS"] == found["ATTITUDE"] == 0
    assert found["HOME_POSITION"] == 2


def test_enormous_rate_is_limited() -> None:
    rates = Rates()
    rates.request_group(EVERY, 65_535)
    assert rates.count(1)["ATTITUDE"] == pytest.approx(20, abs=1)


def sent_bytes_s(rates: Rates, seconds: int) -> float:
    encoder = mavlink.MAVLink(None, 1, COMPONENT)
    total = 0
    for _ in range(50 * seconds):
        rates.bench.now_ns += 20_000_000
        rates.bench.due()
        total += sum(len(one.pack(encoder)) for one in rates.bench.sent(CLIENT.client))
    return total / seconds


def test_slow_line_gets_at_most_its_bytes() -> None:
    rates = Rates(line_bytes_s=SLOW_BYTES_S)
    assert 1500 < sent_bytes_s(rates, 10) <= SLOW_BYTES_S


def test_slow_line_is_never_filled_by_a_request() -> None:
    rates = Rates(line_bytes_s=SLOW_BYTES_S)
    rates.request_group(EVERY, 50)
    rates.set(mavlink.MAVLINK_MSG_ID_ODOMETRY, 20_000)
    assert sent_bytes_s(rates, 10) <= SLOW_BYTES_S
    found = rates.count(10)
    assert found["ATTITUDE"] == pytest.approx(found["ODOMETRY"], abs=1)


def test_fast_line_gets_the_default_rates() -> None:
    rates = Rates(line_bytes_s=11_520)
    assert rates.count(2)["ATTITUDE"] == 20


def test_all_services_fit_a_slow_line() -> None:
    rates = Rates()
    rates.bench.face = face_of(rates.bench.vehicle)
    rates.bench.face.join(CLIENT.client, SLOW_BYTES_S)
    assert sent_bytes_s(rates, 10) <= SLOW_BYTES_S


def test_clients_share_one_build() -> None:
    rates, builds = Rates(), list[int]()

    def build(now_ns: int) -> list[object]:
        builds.append(now_ns)
        return []

    number = mavlink.MAVLINK_MSG_ID_RC_CHANNELS
    rates.bench.vehicle.catalogue.add(MessageSource(number, build, rate_hz=10.0))
    rates.count(1)
    assert len(builds) == 10


def test_client_that_has_gone_gets_nothing() -> None:
    rates = Rates()
    rates.count(1)
    rates.bench.face.forget(CLIENT.client)
    assert not rates.count(1)
    assert not rates.set(mavlink.MAVLINK_MSG_ID_ATTITUDE, 1000)


def test_silent_robot_is_not_shown_as_live() -> None:
    rates = Rates()
    rates.bench.port.telemetry = {}
    found = rates.count(2)
    assert found["SYS_STATUS"] == 4
    assert found["GLOBAL_POSITION_INT"] == found["ATTITUDE"] == found["OBSTACLE_DISTANCE"] == 0


@each("start_ms", [0, 3, 97])
def test_jitter_of_the_rounds_costs_no_message(start_ms: int) -> None:
    """Rounds of 100 ms, each up to 5 ms late, send a stream of 10 Hz in every round."""
    rates = Rates()
    sent, base_ms = 0, 1000 + start_ms
    rates.bench.face.due(1_000_000_000)
    rates.bench.sent()
    for number in range(1, 101):
        late_ms = number * 7 % 6
        rates.bench.face.due((base_ms + 100 * number + late_ms) * 1_000_000)
        sent += sum(one.get_type() == "ATTITUDE" for one in rates.bench.sent(CLIENT.client))
    assert sent == pytest.approx(100, abs=1)


def test_fast_streams_of_a_client_are_announced() -> None:
    rates = Rates()
    rates.count(1)
    assert rates.bench.vehicle.shortest_ns == 100_000_000
    rates.set(mavlink.MAVLINK_MSG_ID_ATTITUDE, 50_000)
    rates.count(1)
    assert rates.bench.vehicle.shortest_ns == 50_000_000
    rates.bench.face.forget(CLIENT.client)
    rates.count(1)
    assert rates.bench.vehicle.shortest_ns == 100_000_000


LIVE = {
    "GLOBAL_POSITION_INT",
    "LOCAL_POSITION_NED",
    "ATTITUDE",
    "VFR_HUD",
    "LOCAL_POSITION_NED_COV",
    "ODOMETRY",
    "OBSTACLE_DISTANCE",
    "DISTANCE_SENSOR",
    "RANGEFINDER",
}


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    bench.face = face_of(bench.vehicle)
    bench.face.join(CLIENT.client)
    bench.port.telemetry |= everything()
    return bench


def test_stale_values_are_not_sent_as_live(bench: Bench) -> None:
    assert {one.get_type() for one in bench.after(2.0)} >= LIVE
    bench.port.telemetry.clear()
    bench.after(0.1)
    found = bench.after(5.0)
    kinds = {one.get_type() for one in found}
    assert not kinds & LIVE
    assert "HEARTBEAT" in kinds
    fixes = {one.fix_type for one in found if one.get_type() == "GPS_RAW_INT"}
    assert fixes == {mavlink.GPS_FIX_TYPE_NO_FIX}
    healths = {
        one.onboard_control_sensors_health for one in found if one.get_type() == "SYS_STATUS"
    }
    assert healths == {0}
    bench.port.telemetry |= everything()
    assert {one.get_type() for one in bench.after(2.0)} >= LIVE


def test_each_client_is_told_once_why_and_when_it_is_over(bench: Bench) -> None:
    bench.after(2.0)
    bench.port.telemetry.clear()
    bench.after(0.9)
    assert words(bench.after(0.2)).startswith("no telemetry arrives from the robot")
    bench.face.join(OTHER.client)
    bench.now_ns += 20_000_000
    bench.due()
    assert words(bench.sent(CLIENT.client)) == ""
    bench.after(3.9)
    bench.port.telemetry |= everything()
    bench.now_ns += 20_000_000
    bench.due()
    sends = [one for one in bench.vehicle.outbox.take() if one.message.get_type() == "STATUSTEXT"]
    assert [one.client for one in sends] == [CLIENT.client, OTHER.client]
    assert words([sends[0].message]) == "telemetry arrives again, after 5 s"


@each(
    ("driver", "who"),
    [("MAVLink 255", "MAVLink 255, or its gateway,"), ("ada", "ada"), ("", "its operator")],
)
def test_client_that_comes_back_learns_why_its_goal_has_ended(driver: str, who: str) -> None:
    """Also at a gateway that was restarted, which has not heard the robot's texts."""
    bench = Bench(SilenceTexts)
    bench.port.telemetry["status"] = make(
        NavigatorStatus,
        vehicle=Vehicle.FAILSAFE,
        vehicle_reason=Reason.OPERATOR_LOST,
        goal=GoalState.ABORTED,
        goal_reason=Reason.OPERATOR_LOST,
    )
    bench.face.join(CLIENT.client)
    assert "fell silent" not in words(bench.after(0.1)), "who it was is not known yet"
    bench.port.telemetry["lease"] = make(LeaseStatus, driver=driver)
    found = words(bench.after(0.5))
    assert found.count(f"goal ABORTED: {who} fell silent; arm again to go on") == 1
    bench.port.telemetry["status"] = make(NavigatorStatus, vehicle=Vehicle.ACTIVE)
    bench.face.join(OTHER.client)
    assert "fell silent" not in words(bench.after(0.5))


def test_single_messages_of_a_silent_robot_are_refused(bench: Bench) -> None:
    bench.after(1.0)
    bench.port.telemetry.clear()
    bench.after(1.5)
    found = bench.send(command(512, 33))
    assert [one.result for one in found if one.get_type() == "COMMAND_ACK"] == [1]
    assert "GLOBAL_POSITION_INT" not in {one.get_type() for one in found}


REQUEST = mavlink.MAV_CMD_REQUEST_MESSAGE
SET_INTERVAL = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
GET_INTERVAL = mavlink.MAV_CMD_GET_MESSAGE_INTERVAL
CAPABILITIES = mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES
READ = ShowParameters()
ATTITUDE = mavlink.MAVLINK_MSG_ID_ATTITUDE
VERSION = mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION


def whole_bench() -> Bench:
    bench = Bench()
    bench.face = face_of(bench.vehicle)
    bench.port.telemetry = everything()
    bench.vehicle.commit = "0123456789abcdef"
    bench.face.join(CLIENT.client)
    bench.after(0.04)
    return bench


def ask(bench: Bench, command: int, *params: float) -> tuple[int, list[MavMessage]]:
    """Return the result and what is sent besides it and its words."""
    filled = [*params, *[0.0] * (7 - len(params))]
    found = bench.send(mavlink.MAVLink_command_long_message(1, 1, command, 0, *filled))
    results = [one.result for one in found if one.get_type() == "COMMAND_ACK"]
    assert len(results) == 1
    rest = [one for one in found if one.get_type() not in ("COMMAND_ACK", "STATUSTEXT")]
    return results[0], rest


@each("ask_for", ["512", "520", "183"])
def test_autopilot_version_comes_by_each_request(ask_for: str) -> None:
    bench = whole_bench()
    if ask_for == "183":
        request = mavlink.MAVLink_autopilot_version_request_message(1, 1)
        messages = bench.send(request)
    elif ask_for == "520":
        messages = ask(bench, CAPABILITIES, 1.0)[1]
    else:
        messages = ask(bench, REQUEST, VERSION)[1]
    (message,) = messages
    assert message.capabilities == ardupilot.CAPABILITIES
    assert message.flight_sw_version >> 24 == 4
    assert message.flight_sw_version & 0xFF == mavlink.FIRMWARE_VERSION_TYPE_DEV
    assert bytes(message.flight_custom_version) == b"01234567"
    assert message.uid


def test_requested_message_is_sent_twice_on_a_lossy_line() -> None:
    bench = whole_bench()
    bench.vehicle.lossy = {CLIENT.client}
    assert len(ask(bench, REQUEST, VERSION)[1]) == 2


def test_message_that_mavlink_1_cannot_carry_is_not_accepted() -> None:
    bench, old = whole_bench(), CLIENT._replace(is_mavlink1=True)
    for number, result in (
        (REQUEST, mavlink.MAV_RESULT_UNSUPPORTED),
        (SET_INTERVAL, mavlink.MAV_RESULT_FAILED),
    ):
        found = bench.send(command(number, mavlink.MAVLINK_MSG_ID_ODOMETRY, 1e6), old)
        assert acks(found) == [(number, result)]
        assert "MAVLink 2" in words(found)
        bench.after(1.1)
    assert bench.send(command(REQUEST, VERSION), old)[0].get_type() == "AUTOPILOT_VERSION"


def test_version_of_another_robot_has_another_id() -> None:
    first, second = (ardupilot.autopilot_version(name, "") for name in ("r1", "r2"))
    assert first.uid != second.uid


def test_every_stream_can_be_requested_and_encoded() -> None:
    bench = whole_bench()
    driving = status(vehicle=Vehicle.ACTIVE, mode=Mode.GUIDED, goal=GoalState.DRIVING)
    bench.port.telemetry["status"] = driving
    bench.after(0.02)
    encoder = mavlink.MAVLink(None, 1, 1)
    for stream in STREAMS:
        source = stream.source(bench.vehicle)
        result, messages = ask(bench, REQUEST, source.number)
        assert result == mavlink.MAV_RESULT_ACCEPTED, source.number
        for message in messages:
            frame = message.pack(encoder)
            assert len(frame) <= source.largest_bytes
            (found,) = mavlink.MAVLink(None, 1, 1).parse_buffer(frame)
            assert found.get_msgId() == source.number


ANSWERS = {"COMMAND_ACK", "STATUSTEXT"}


def test_all_that_is_sent_by_itself_can_be_requested() -> None:
    bench = whole_bench()
    bench.port.telemetry["mission"] = mission_status(MissionState.RUNNING)
    driving = status(vehicle=Vehicle.ACTIVE, mode=Mode.GUIDED, goal=GoalState.DRIVING)
    bench.port.telemetry["status"] = driving
    sent = {one.get_msgId() for one in bench.after(5.0) if one.get_type() not in ANSWERS}
    assert len(sent) >= 21
    for number in sent:
        result, messages = ask(bench, REQUEST, number)
        assert result == mavlink.MAV_RESULT_ACCEPTED, number
        assert {one.get_msgId() for one in messages} == {number}


def test_heartbeat_can_be_requested_but_not_slowed_down() -> None:
    bench = whole_bench()
    result, (beat,) = ask(bench, REQUEST, mavlink.MAVLINK_MSG_ID_HEARTBEAT)
    assert (result, beat.get_type()) == (mavlink.MAV_RESULT_ACCEPTED, "HEARTBEAT")
    assert ask(bench, SET_INTERVAL, 0, -1)[0] == mavlink.MAV_RESULT_FAILED
    assert ask(bench, SET_INTERVAL, 0, 1e6)[0] == mavlink.MAV_RESULT_ACCEPTED
    result, (interval,) = ask(bench, GET_INTERVAL, 0)
    assert (result, interval.interval_us) == (mavlink.MAV_RESULT_ACCEPTED, 1_000_000)
    bench.after(0.4)
    assert [one.get_type() for one in bench.after(3.0)].count("HEARTBEAT") == 3


def test_unknown_message_is_unsupported_at_once() -> None:
    assert ask(whole_bench(), REQUEST, 11_000)[0] == mavlink.MAV_RESULT_UNSUPPORTED


@each("number", [nan, inf, -1.0, 0.5, 1e30])
def test_request_for_no_message_is_denied(number: float) -> None:
    assert ask(whole_bench(), REQUEST, number) == (mavlink.MAV_RESULT_DENIED, [])
    assert ask(whole_bench(), GET_INTERVAL, number) == (mavlink.MAV_RESULT_DENIED, [])


def test_missing_values_are_rejected_for_now() -> None:
    bench = whole_bench()
    bench.port.telemetry = {}
    bench.after(0.02)
    assert ask(bench, REQUEST, ATTITUDE) == (mavlink.MAV_RESULT_TEMPORARILY_REJECTED, [])


def test_description_is_sent_when_the_robot_has_answered() -> None:
    bench = whole_bench()
    found = bench.send(mavlink.MAVLink_command_long_message(1, 1, REQUEST, 0, 397, *[0] * 6))
    assert not found
    bench.port.waiting = deque(one for one in bench.port.waiting if one[0] == READ)
    bench.port.answer(robot_table())
    description, acknowledgement = bench.sent(CLIENT.client)
    assert description.get_type() == ComponentMetadata.msgname
    assert acknowledgement.result == mavlink.MAV_RESULT_ACCEPTED


def test_description_is_refused_if_the_robot_does_not_answer() -> None:
    bench = whole_bench()
    bench.send(mavlink.MAVLink_command_long_message(1, 1, REQUEST, 0, 397, *[0] * 6))
    bench.port.waiting = deque(one for one in bench.port.waiting if one[0] == READ)
    bench.port.answer(error="no answer")
    results = [one.result for one in bench.sent() if one.get_type() == "COMMAND_ACK"]
    assert results == [mavlink.MAV_RESULT_TEMPORARILY_REJECTED]


def test_modes_are_listed_one_by_one_or_all() -> None:
    bench = whole_bench()
    messages = ask(bench, REQUEST, AvailableModes.id, 0.0)[1]
    assert [one.mode_index for one in messages] == list(range(1, len(messages) + 1))
    assert {one.number_modes for one in messages} == {len(messages)}
    assert {one.custom_mode for one in messages} == set(ardupilot.MODES_BY_NUMBER)
    (second,) = ask(bench, REQUEST, AvailableModes.id, 2.0)[1]
    assert (second.mode_index, second.mode_name) == (2, b"Hold")
    beyond = ask(bench, REQUEST, AvailableModes.id, 9.0)
    assert beyond == (mavlink.MAV_RESULT_DENIED, [])


def modes_in(messages: list[MavMessage]) -> list[int]:
    return [one.custom_mode for one in messages if one.get_msgId() == CurrentMode.id]


def test_mode_is_sent_to_clients_that_ask_for_modes() -> None:
    bench = whole_bench()
    assert modes_in(bench.after(4.0)) == []
    ask(bench, REQUEST, AvailableModes.id, 0.0)
    assert modes_in(bench.after(3.9)) == [4, 4]


def test_mode_is_sent_at_once_when_it_changes() -> None:
    bench = whole_bench()
    ask(bench, REQUEST, AvailableModes.id, 0.0)
    bench.after(1.0)
    bench.port.telemetry["status"] = status(mode=Mode.GUIDED)
    assert modes_in(bench.after(0.1)) == [15]


def test_interval_is_set_and_read() -> None:
    bench = whole_bench()
    assert ask(bench, SET_INTERVAL, ATTITUDE, 250_000)[0] == mavlink.MAV_RESULT_ACCEPTED
    (message,) = ask(bench, GET_INTERVAL, ATTITUDE)[1]
    assert (message.message_id, message.interval_us) == (ATTITUDE, 250_000)
    ask(bench, SET_INTERVAL, ATTITUDE, -1)
    (message,) = ask(bench, REQUEST, mavlink.MAVLINK_MSG_ID_MESSAGE_INTERVAL, ATTITUDE)[1]
    assert message.interval_us == -1


def test_interval_of_an_unknown_message_is_refused() -> None:
    bench = whole_bench()
    assert ask(bench, SET_INTERVAL, 11_000, 1000)[0] == mavlink.MAV_RESULT_FAILED
    result, (message,) = ask(bench, GET_INTERVAL, 11_000)
    assert (result, message.interval_us) == (mavlink.MAV_RESULT_FAILED, 0)


@each("interval_us", [nan, inf, -2.0, 0.5])
def test_senseless_interval_is_denied(interval_us: float) -> None:
    bench = whole_bench()
    assert ask(bench, SET_INTERVAL, ATTITUDE, interval_us)[0] == mavlink.MAV_RESULT_DENIED


def test_enormous_interval_is_taken() -> None:
    bench = whole_bench()
    assert ask(bench, SET_INTERVAL, ATTITUDE, 3e38)[0] == mavlink.MAV_RESULT_ACCEPTED
    (message,) = ask(bench, GET_INTERVAL, ATTITUDE)[1]
    assert message.interval_us == 0x7FFF_FFFF


HERE = (473_769_000, 85_417_000)
THERE = (480_000_000, 90_000_000)


def origin_bench(**telemetry: object) -> Bench:
    bench = Bench()
    bench.face = face_of(bench.vehicle)
    bench.port.telemetry = everything() | telemetry
    bench.after(0.02)
    bench.sent()
    return bench


def move(bench: Bench, place: tuple[int, int], height_mm: int = 5000) -> MavMessage:
    """Return GPS_GLOBAL_ORIGIN, which is sent in any case."""
    found = bench.send(mavlink.MAVLink_set_gps_global_origin_message(1, *place, height_mm))
    (origin,) = [one for one in found if one.get_type() == "GPS_GLOBAL_ORIGIN"]
    texts = [one for one in found if one.get_type() == "STATUSTEXT"]
    is_moved = (origin.latitude, origin.longitude) == place
    assert bool(texts) != is_moved
    return origin


def test_origin_moves() -> None:
    bench = origin_bench()
    origin = move(bench, THERE)
    assert (origin.latitude, origin.longitude, origin.altitude) == (*THERE, 5000)
    assert bench.vehicle.origin.latitude_deg == 48.0


@each(
    "place",
    [THERE, (850_000_000, 1_800_000_000), (-850_000_000, -1_800_000_000), (1, 1_799_999_999)],
)
def test_positions_and_goals_move_with_the_origin(place: tuple[int, int]) -> None:
    bench = origin_bench()
    move(bench, place)
    home = home_at(GlobalPlace(*place))
    assert home is not None
    (here,) = global_position(bench.vehicle, bench.now_ns)
    assert local_at(home, GlobalPlace(here.lat, here.lon)) == pytest.approx((3.0, 4.0), abs=0.01)
    goal = place_goal(bench.vehicle.origin, here.lat / 1e7, here.lon / 1e7, None)
    assert (goal.x_m, goal.y_m) == pytest.approx((3.0, 4.0), abs=0.01)


def test_home_is_told_with_the_new_origin() -> None:
    bench = origin_bench()
    found = bench.send(mavlink.MAVLink_set_gps_global_origin_message(1, *THERE, 5000))
    (home,) = [one for one in found if one.get_type() == "HOME_POSITION"]
    assert (home.latitude, home.longitude, home.altitude) == (*THERE, 5000)


@each("state", [status(vehicle=Vehicle.ACTIVE), None])
def test_origin_stays_unless_the_robot_is_disarmed(state: object) -> None:
    bench = origin_bench(status=state)
    origin = move(bench, THERE)
    assert (origin.latitude, origin.longitude) == HERE
    assert bench.vehicle.origin == ORIGIN


def test_same_origin_is_accepted_while_armed() -> None:
    bench = origin_bench(status=status(vehicle=Vehicle.ACTIVE))
    assert move(bench, HERE, 0).latitude == HERE[0]


@each("place", [(0, 0), (900_000_000, 1), (1, -1_800_000_001), (2**31 - 1, 5)])
def test_place_beyond_the_globe_is_refused(place: tuple[int, int]) -> None:
    bench = origin_bench()
    assert move(bench, place).latitude == HERE[0]


def test_origin_in_space_is_refused() -> None:
    assert move(origin_bench(), THERE, 2**31 - 1).latitude == HERE[0]


def test_other_client_does_not_move_the_origin() -> None:
    bench = origin_bench()
    bench.take_control(OTHER)
    assert move(bench, THERE).latitude == HERE[0]


def test_client_that_may_only_watch_does_not_move_the_origin() -> None:
    bench = origin_bench()
    message = mavlink.MAVLink_set_gps_global_origin_message(1, *THERE, 0)
    bench.send(message, CLIENT._replace(barred=WATCHER))
    assert bench.vehicle.origin == ORIGIN


@each(
    ("x", "height_m", "result"),
    [
        (THERE[0], 5.0, mavlink.MAV_RESULT_ACCEPTED),
        (950_000_000, 5.0, mavlink.MAV_RESULT_DENIED),
        (THERE[0], float("nan"), mavlink.MAV_RESULT_DENIED),
    ],
)
def test_command_moves_the_origin_too(x: int, height_m: float, result: int) -> None:
    bench = origin_bench()
    frame = mavlink.MAV_FRAME_GLOBAL
    place = (x, THERE[1], height_m)
    command = mavlink.MAVLink_command_int_message(
        *(1, 1, frame, SET_GLOBAL_ORIGIN, 0, 0, 0.0, 0.0, 0.0, 0.0), *place
    )
    command._header.seq = 1
    found = bench.send(command)
    assert [one.result for one in found if one.get_type() == "COMMAND_ACK"] == [result]
    moved = bench.vehicle.origin != ORIGIN
    assert moved == (result == mavlink.MAV_RESULT_ACCEPTED)


def test_timesync_is_answered_to_its_sender_in_the_time_of_the_messages() -> None:
    bench = Bench(ClockSync)
    bench.after(2.0)
    bench.receive(TimeSync(0, 77), CLIENT)
    (send,) = bench.vehicle.outbox.take()
    answer = send.message
    assert (send.client, answer.ts1, answer.tc1) == (CLIENT.client, 77, 2_000_000_000)
    assert (answer.target_system, answer.target_component) == (CLIENT.system, CLIENT.component)


def test_answer_of_timesync_to_others_is_ignored() -> None:
    assert Bench(ClockSync).send(TimeSync(5, 77)) == []


def test_timesync_with_and_without_its_target_is_understood() -> None:
    encoder = mavlink.MAVLink(None, 255, 190)
    old = mavlink.MAVLink_timesync_message(0, 9)
    for request in (old, TimeSync(0, 9, 1, 1)):
        (found,) = mavlink.MAVLink(None).parse_buffer(request.pack(encoder))
        assert (found.tc1, found.ts1) == (0, 9)
        (answer,) = Bench(ClockSync).send(found)
        assert answer.ts1 == 9


def test_ping_is_answered_unchanged() -> None:
    bench = Bench(ClockSync)
    (answer,) = bench.send(mavlink.MAVLink_ping_message(123, 7, 0, 0), OTHER)
    assert (answer.time_usec, answer.seq) == (123, 7)
    assert (answer.target_system, answer.target_component) == (OTHER.system, OTHER.component)
    assert bench.send(mavlink.MAVLink_ping_message(123, 7, 1, 1)) == []


def test_texts_of_the_robot_reach_all_clients() -> None:
    bench = Bench(RobotTexts)
    words = "wheel stuck: " + 60 * "x"
    bench.port.texts = [
        Statustext(severity=Severity.WARNING, text="slipping"),
        *pieces_of(words, 9, Severity.ERROR),
    ]
    found = bench.after(0.04)
    assert (found[0].severity, found[0].text) == (Severity.WARNING, "slipping")
    assert "".join(one.text for one in found[1:]) == words
    assert {one.severity for one in found[1:]} == {Severity.ERROR}
    assert [one.chunk_seq for one in found[1:]] == [0, 1]
