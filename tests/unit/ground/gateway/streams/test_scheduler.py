"""Rates of streams: by client, by group, by message, and within what a slow line carries."""

from collections import Counter

import pytest

from gateways.mavlink.mav_service import COMPONENT
from gateways.mavlink.mav_vehicle import MavVehicle, MessageSource
from gateways.mavlink.mavlink_dialect import mavlink
from gateways.mavlink.services import face_of
from gateways.mavlink.streams import StreamScheduler
from tests.support.each import each
from tests.support.gateway.fake_port import CLIENT, OTHER, Bench
from tests.support.gateway.telemetry import everything

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
            self.bench.face.due(self.bench.now_ns)
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
        rates.bench.face.due(rates.bench.now_ns)
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
