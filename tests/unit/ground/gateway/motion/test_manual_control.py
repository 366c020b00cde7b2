import pytest

from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from protocol.wire.enums import Mode
from protocol.wire.messages import LeaseStatus
from tests.support.gateway.fake_port import CLIENT, OTHER, Bench
from tests.support.gateway.messages import local_target, manual_control, rc_override, words
from tests.support.gateway.piloting import LIMITS, driving_bench, show

FASTEST_M_S, FASTEST_RAD_S = LIMITS["v_max_m_s"], LIMITS["yaw_max_rad_s"]


@pytest.fixture
def bench() -> Bench:
    bench = driving_bench(Mode.MANUAL)
    bench.vehicle.control.ensure(CLIENT, lambda _: None)
    bench.face.join(CLIENT.client)
    return bench


def echoes(messages: list[MavMessage]) -> list[tuple[int, int, int]]:
    """Return channels 1, 3 and 9 of each RC_CHANNELS."""
    found = (m for m in messages if m.get_type() == "RC_CHANNELS")
    return [(m.chan1_raw, m.chan3_raw, m.chan9_raw) for m in found]


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (manual_control(z=500), (0.4, 0.0)),
        (manual_control(z=-1000), (-0.8, 0.0)),
        (manual_control(y=1000), (0.0, -2.0)),
        (manual_control(z=0x7FFF, y=500), (0.0, -1.0)),
        (manual_control(z=-32768, y=32766), (-0.8, -2.0)),
        (manual_control(x=1000, r=1000), (0.0, 0.0)),
        (manual_control(z=500, target=0), (0.4, 0.0)),
        (rc_override(1500, 0xFFFF, 1750), (0.4, 0.0)),
        (rc_override(2000, 0xFFFF, 1500), (0.0, -2.0)),
        (rc_override(1000), (0.0, 2.0)),
        (rc_override(2200, 0xFFFF, 800), (-0.8, -2.0)),
    ],
)
def test_axes_are_shares_of_the_fastest(
    bench: Bench, message: MavMessage, expected: tuple[float, float]
) -> None:
    bench.send(message)
    assert bench.port.driven[0] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("message", "lasts_s"), [(manual_control(z=1000), 0.5), (rc_override(1500, 0xFFFF, 2000), 1.0)]
)
def test_speeds_end_with_their_time(bench: Bench, message: MavMessage, lasts_s: float) -> None:
    """Each speed lasts 250 ms on the robot, so the last is sent so long before the end."""
    bench.send(message)
    bench.after(lasts_s - 0.25 - 0.06)
    count = len(bench.port.driven)
    bench.after(0.06)
    assert len(bench.port.driven) == count + 1
    bench.after(1.0)
    assert len(bench.port.driven) == count + 1
    assert set(bench.port.driven) == {(FASTEST_M_S, 0.0)}


def test_released_channels_stop_at_once(bench: Bench) -> None:
    bench.send(rc_override(1500, 0xFFFF, 2000))
    bench.send(rc_override(0, 0xFFFF, 0))
    assert bench.port.driven[-1] == (0.0, 0.0)


def test_channel_that_is_left_keeps_its_value(bench: Bench) -> None:
    bench.send(rc_override(1500, 0xFFFF, 2000))
    bench.send(rc_override(2000))
    assert bench.port.driven[-1] == (FASTEST_M_S, -FASTEST_RAD_S)


@pytest.mark.parametrize("value", [1, 799, 2201, 65534])
def test_channel_out_of_range_changes_nothing(bench: Bench, value: int) -> None:
    bench.send(rc_override(1500, 0xFFFF, 2000))
    bench.send(rc_override(1500, 0xFFFF, value))
    assert bench.port.driven[-1] == (FASTEST_M_S, 0.0)


def test_overrides_are_echoed(bench: Bench) -> None:
    assert echoes(bench.after(1.0)) == []
    bench.send(rc_override(1600, 0xFFFF, 1400, upper=1234))
    found = echoes(bench.after(0.8))
    assert set(found) == {(1600, 1400, 1234)}
    assert echoes(bench.after(2.0)) == []


def test_upper_channels_are_released_by_their_own_value(bench: Bench) -> None:
    bench.send(rc_override(1600, upper=1234))
    bench.send(rc_override(1600, upper=0xFFFE))
    assert echoes(bench.after(0.6))[0] == (1600, 0xFFFF, 0xFFFF)


@pytest.mark.parametrize("mode", [Mode.HOLD, Mode.AUTO, Mode.GUIDED, Mode.SMART_RTL])
def test_axes_are_ignored_outside_manual(bench: Bench, mode: Mode) -> None:
    show(bench, mode)
    for message in (manual_control(z=1000), rc_override(2000, 2000, 2000)):
        assert bench.send(message) == []
    bench.after(0.2)
    assert bench.port.driven == []


def test_axes_do_not_disturb_the_speeds_of_guided() -> None:
    bench = driving_bench(Mode.GUIDED)
    bench.send(local_target(frame=8, vx=0.25))
    bench.port.answer()
    show(bench, Mode.MANUAL)
    bench.send(manual_control(z=1000))
    bench.after(0.2)
    assert set(bench.port.driven) == {(0.25, 0.0)}


def test_leaving_manual_ends_the_stick(bench: Bench) -> None:
    bench.send(manual_control(z=1000))
    show(bench, Mode.HOLD)
    show(bench, Mode.MANUAL)
    bench.after(0.3)
    assert bench.port.driven == [(FASTEST_M_S, 0.0)]


def test_axes_of_another_client_are_refused(bench: Bench) -> None:
    assert "take control" in words(bench.send(manual_control(z=1000), OTHER))
    assert bench.port.driven == []


def test_axes_without_control_take_none() -> None:
    bench = driving_bench(Mode.MANUAL)
    assert "take control" in words(bench.send(rc_override(2000, 2000, 2000)))
    assert bench.port.leases == []
    assert bench.port.driven == []


def test_axes_for_another_vehicle_are_ignored(bench: Bench) -> None:
    assert bench.send(manual_control(z=1000, target=2)) == []
    assert bench.port.driven == []


def test_stick_ends_with_the_loss_of_control(bench: Bench) -> None:
    bench.send(manual_control(z=1000))
    bench.port.telemetry["lease"] = LeaseStatus(
        time_ns=0, lapses_ms=1000, held=1, holder="ground/7", name="ada"
    )
    bench.after(0.35)
    count = len(bench.port.driven)
    bench.after(0.4)
    assert len(bench.port.driven) == count


def test_unknown_limits_drive_nothing(bench: Bench) -> None:
    bench.vehicle.parameters.clear()
    bench.send(manual_control(z=1000))
    assert bench.port.driven == []


def test_rc_channels_is_a_stream_of_its_group(bench: Bench) -> None:
    source = bench.vehicle.catalogue.find(mavlink.MAVLINK_MSG_ID_RC_CHANNELS)
    assert source is not None
    assert source.group == mavlink.MAV_DATA_STREAM_RC_CHANNELS
