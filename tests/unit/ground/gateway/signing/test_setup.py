"""Row 52: conditions for setting the key, and the rights of unsigned clients."""

from typing import Any

from gateways.mavlink.clients import ClientLink, NoFile
from gateways.mavlink.commands.vehicle_commands import SigningSetup
from gateways.mavlink.framing import MavFrame
from gateways.mavlink.liveness import HeartbeatStream
from gateways.mavlink.mav_service import WATCHER
from gateways.mavlink.mav_vehicle import Face
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from gateways.mavlink.services import face_of
from gateways.mavlink.signing import Policy, SigningGuard
from ground.user.mavlink_keys import KeyRing, SigningKey
from protocol.wire.enums import Vehicle as VehicleState
from runtime.errors import UserError
from tests.support.each import each
from tests.support.gateway.fake_port import CLIENT, Bench
from tests.support.gateway.messages import acks, command, words
from tests.support.gateway.telemetry import status
from tests.unit.ground.gateway.signing.test_verifier import KEY, NOW_S, framed

NEW = bytes(range(32))
LOCAL, REMOTE = CLIENT, CLIENT._replace(is_loopback=False, barred=WATCHER)
SIGNED = CLIENT._replace(is_loopback=False, is_signed=True)
ring = KeyRing(key=(SigningKey(secret=KEY.hex()),))


class SetupBench(Bench):
    def __init__(self, policy: Policy = Policy.LOOPBACK) -> None:
        super().__init__()
        self.saved: list[KeyRing] = []
        self.guard = SigningGuard(
            lambda: NOW_S * 10**9 + self.now_ns, ring, {"end": policy}, save=self.save
        )
        setup = SigningSetup(self.vehicle, self.guard)
        self.face = Face(self.vehicle, [HeartbeatStream(self.vehicle), setup])
        self.port.telemetry["status"] = status()
        self.after(0.02)
        self.link = ClientLink(1, "peer", 0)
        self.error: UserError | None = None

    def save(self, changed: KeyRing) -> None:
        if self.error is not None:
            raise self.error
        self.saved.append(changed)

    def set_key(self, key: bytes, sender: Any) -> str:
        setup = mavlink.MAVLink_setup_signing_message(1, 1, list(key), 0)
        return words(self.send(setup, sender))

    def next_heartbeat(self) -> MavFrame:
        (found,) = (one for one in self.after(1.0) if one.get_type() == "HEARTBEAT")
        return framed(self.link.encode(1, found, self.guard))


def is_valid(frame: MavFrame, key: bytes) -> bool:
    receiver = mavlink.MAVLink(NoFile())
    receiver.signing.secret_key = key
    try:
        receiver.decode(bytearray(frame.data))
    except mavlink.MAVError:
        return False
    return frame.is_signed


@each("sender", [LOCAL, SIGNED])
def test_key_of_a_disarmed_robot_is_replaced(sender: Any) -> None:
    bench = SetupBench()
    assert is_valid(bench.next_heartbeat(), KEY)
    assert bench.set_key(NEW, sender) == ""
    frame = bench.next_heartbeat()
    assert is_valid(frame, NEW)
    assert not is_valid(frame, KEY)
    assert [[key.raw for key in one.key] for one in bench.saved] == [[NEW]]
    assert bench.set_key(NEW, sender) == ""
    assert len(bench.saved) == 1


def test_key_of_zeros_ends_signing() -> None:
    bench = SetupBench()
    assert bench.set_key(bytes(32), LOCAL) == ""
    assert not bench.next_heartbeat().is_signed
    assert bench.saved == [KeyRing()]


def severity_and_words(messages: list[MavMessage]) -> tuple[int, str]:
    return next(one.severity for one in messages if one.get_type() == "STATUSTEXT"), words(messages)


@each("state", [VehicleState.ACTIVE, None])
def test_key_of_an_armed_or_silent_robot_stays(state: VehicleState | None) -> None:
    bench = SetupBench()
    bench.port.telemetry["status"] = None if state is None else status(vehicle=state)
    bench.after(0.02)
    setup = mavlink.MAVLink_setup_signing_message(1, 1, list(NEW), 0)
    severity, text = severity_and_words(bench.send(setup, LOCAL))
    assert severity == mavlink.MAV_SEVERITY_ERROR
    assert "signing" in text
    assert not bench.saved


def test_key_stays_while_another_robot_of_the_gateway_is_armed() -> None:
    bench, other = SetupBench(), Bench(system=2)
    other.face = Face(other.vehicle, [SigningSetup(other.vehicle, bench.guard)])
    other.port.telemetry["status"] = status(vehicle=VehicleState.ACTIVE)
    other.after(0.02)
    assert "signing" in bench.set_key(NEW, LOCAL)
    assert not bench.saved
    other.port.telemetry["status"] = status()
    other.after(0.02)
    bench.after(1.0)
    assert bench.set_key(NEW, LOCAL) == ""


def test_stranger_sets_no_key() -> None:
    bench = SetupBench()
    assert "signing" in bench.set_key(NEW, REMOTE)
    bench.after(1.0)
    assert "signing" in bench.set_key(bytes(32), LOCAL._replace(barred=WATCHER))
    assert not bench.saved
    assert is_valid(bench.next_heartbeat(), KEY)


def test_required_signing_cannot_be_ended_by_a_client() -> None:
    bench = SetupBench(Policy.REQUIRE)
    assert "signing" in bench.set_key(bytes(32), SIGNED)
    assert not bench.saved


def test_key_that_cannot_be_saved_is_not_used() -> None:
    bench = SetupBench()
    bench.error = UserError("disk full")
    assert "signing: disk full" in bench.set_key(NEW, LOCAL)
    assert is_valid(bench.next_heartbeat(), KEY)


def test_client_without_rights_reads_and_changes_nothing() -> None:
    bench = Bench()
    bench.face = face_of(bench.vehicle)
    bench.port.telemetry["status"] = status()
    bench.face.join(REMOTE.client)
    assert any(one.get_type() == "HEARTBEAT" for one in bench.after(1.0))
    assert acks(bench.send(command(512, 148), REMOTE)) == [(512, 0)]
    refused = (
        mavlink.MAVLink_param_set_message(1, 1, b"D_OBS_M", 0.5, 9),
        mavlink.MAVLink_mission_count_message(1, 1, 3, 0),
        mavlink.MAVLink_mission_clear_all_message(1, 1, 0),
        mavlink.MAVLink_mission_set_current_message(1, 1, 1),
        mavlink.MAVLink_set_gps_global_origin_message(1, 10, 10, 0),
        mavlink.MAVLink_manual_control_message(1, 500, 500, 0, 0, 0),
        mavlink.MAVLink_rc_channels_override_message(1, 1, *[1500] * 8),
        mavlink.MAVLink_log_erase_message(1, 1),
    )
    for message in refused:
        bench.after(1.0)
        bench.send(message, REMOTE)
    for number in (400, 176, 185, 192, 20, 300, 21, 246, 179, 32100):
        ((_, result),) = acks(bench.send(command(number, 1), REMOTE))
        assert result in (2, 3), number
    bench.after(1.0)
    assert not [one for one in bench.port.performed if one.moves]
    assert not bench.port.leases
    assert not bench.port.stops
    assert not bench.port.driven
