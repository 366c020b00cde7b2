"""Bad input and trouble, through the whole gateway: no frame acts that should not."""

import socket
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from checks.harness.until import PATIENCE_S, until
from gateways.mavlink.endpoints import MAX_PEERS, Arrival, opened
from gateways.mavlink.gateway import MAX_OLD_TURNS, STALL_NS
from gateways.mavlink.mavlink_dialect import MavMessage, MissionCount, mavlink
from gateways.mavlink.operator_control import SILENCE_NS
from gateways.mavlink.signing import EPOCH_S, PER_S, STAMP_NS, Policy, SigningGuard
from ground.commands.arm import Arm
from ground.commands.hold import Hold
from ground.commands.mission import AnnounceItems, UploadMission
from ground.user.mavlink_keys import KeyRing, SigningKey
from protocol.wire.enums import Vehicle
from protocol.wire.reasons import Reason
from tests.support.each import each
from tests.support.gateway.benches import line_of
from tests.support.gateway.fake_port import (
    SYSTEM,
    CommandedPort,
    WholeGateway,
    acks,
    command,
    everything,
    status,
    words,
)

HEARTBEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
ARM = command(400, 1)
STOP, CLEAR = command(185, 1), command(185, 0)
ITEMS = line_of(2)
ACCEPTED, DENIED, NOT_IN_CONTROL = 0, 2, 10


@pytest.fixture
def whole() -> Iterator[WholeGateway]:
    whole = WholeGateway(CommandedPort())
    whole.port.telemetry |= everything()
    yield whole
    whole.close()


def sent(whole: WholeGateway, message: MavMessage, peer: str = "a", system: int = 255) -> None:
    whole.send(message, peer, system)
    whole.run(0.04)


def results(whole: WholeGateway, peer: str) -> list[tuple[int, int]]:
    return acks(whole.sent_to(peer, "COMMAND_ACK"))


def frame_of(message: MavMessage, *, is_mavlink1: bool = False) -> bytes:
    frame: bytes = message.pack(mavlink.MAVLink(None, 255, 190), force_mavlink1=is_mavlink1)
    return frame


def damaged(at: int) -> bytes:
    frame = bytearray(frame_of(ARM))
    frame[at] ^= 0x55
    return bytes(frame)


BAD_FRAMES = {
    "truncated": frame_of(ARM)[:-3],
    "unknown message": damaged(9),
    "wrong checksum": damaged(-1),
    "wrong length": damaged(1),
    "unknown flag": damaged(2),
    "MAVLink 1, wrong checksum": frame_of(ARM, is_mavlink1=True)[:-1] + b"\0",
    "another system": frame_of(mavlink.MAVLink_command_long_message(9, 1, 400, 0, *[1.0] * 7)),
    "another component": frame_of(mavlink.MAVLink_command_long_message(1, 9, 400, 0, *[1.0] * 7)),
}


@pytest.mark.parametrize("kind", BAD_FRAMES)
def test_bad_frame_does_not_act_and_hides_no_good_one(whole: WholeGateway, kind: str) -> None:
    sent(whole, HEARTBEAT)
    whole.endpoint.deliver("a", BAD_FRAMES[kind])
    whole.run(0.6)  # a frame whose end is missing waits for so long
    assert whole.port.performed == []
    assert whole.port.leases == []
    sent(whole, ARM)
    assert whole.port.performed == [Arm()]


def test_mavlink_1_commands_like_mavlink_2(whole: WholeGateway) -> None:
    whole.send(ARM, is_mavlink1=True)
    whole.run(0.04)
    assert whole.port.performed == [Arm()]
    whole.port.answer()
    whole.run(0.04)
    assert {frame[0] for _, frame in whole.endpoint.sent} == {mavlink.PROTOCOL_MARKER_V1}


def test_sender_with_the_ids_of_the_vehicle_is_ignored(whole: WholeGateway) -> None:
    frame = ARM.pack(mavlink.MAVLink(None, SYSTEM, 1))
    whole.endpoint.deliver("a", frame)
    whole.run(0.1)
    assert whole.port.leases == []


def test_same_ids_from_another_computer_are_another_client(
    whole: WholeGateway,
) -> None:
    whole.gateway._guard._policies = {"test": Policy.ANYONE}
    whole.endpoint.is_loopback = False
    sent(whole, ARM, "a")
    whole.port.answer()
    sent(whole, ARM, "b")
    sent(whole, command(32100, 0), "b")
    sent(whole, mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0), "b")
    assert results(whole, "b") == [(400, NOT_IN_CONTROL), (32100, NOT_IN_CONTROL)]
    assert whole.port.performed == [Arm()]
    assert whole.port.driven == []
    assert len(whole.port.leases) == 1
    whole.run(SILENCE_NS / 1e9 - 1)
    sent(whole, HEARTBEAT, "b")  # keeps only itself alive
    whole.run(1.5)
    assert whole.face.vehicle.control.owner is None


def test_restarted_station_is_obeyed_well_within_a_second(
    whole: WholeGateway,
) -> None:
    sent(whole, HEARTBEAT, "a")
    sent(whole, ARM, "a")
    whole.port.answer()
    sent(whole, HEARTBEAT, "b")
    sent(whole, ARM, "b")
    assert whole.port.performed == [Arm()]
    whole.run(0.7)
    assert whole.port.performed == [Arm(), Arm()]
    whole.port.answer()
    whole.run(0.04)
    assert results(whole, "b") == [(400, ACCEPTED)]
    assert "another operator" not in words(whole.sent_to("b", "STATUSTEXT"))


def test_every_client_may_stop_but_only_the_owner_clears(whole: WholeGateway) -> None:
    sent(whole, ARM, "a")
    whole.port.answer()
    sent(whole, STOP, "b", 254)
    assert len(whole.port.stops) == 1
    whole.port.telemetry["status"] = status(vehicle=Vehicle.EMERGENCY_STOP)
    sent(whole, CLEAR, "b", 254)
    sent(whole, command(400, 1, 21196), "b", 254)
    assert results(whole, "b") == [(185, NOT_IN_CONTROL), (400, NOT_IN_CONTROL)]
    assert whole.port.performed == [Arm()]
    sent(whole, CLEAR, "a")
    assert len(whole.port.performed) == 2


def test_client_without_a_place_stops_the_robot_and_is_told(whole: WholeGateway) -> None:
    for number in range(MAX_PEERS):
        whole.send(HEARTBEAT, f"flood {number}")
    whole.run(0.1)
    sent(whole, HEARTBEAT, "new")
    sent(whole, STOP, "new")
    assert len(whole.port.stops) == 1
    whole.port.stops[0](whole.port.accepted)
    whole.run(1.5)
    assert results(whole, "new") == [(185, ACCEPTED)]
    assert whole.sent_to("new", "HEARTBEAT") == []
    assert len(whole.sent_to("flood 0", "HEARTBEAT")) >= 1


@each("kind", ["udpin", "tcpin"])
def test_client_without_a_place_stops_the_robot_by_a_socket(kind: str) -> None:
    endpoint: Any = opened(f"{kind}:127.0.0.1:0")
    whole = WholeGateway(CommandedPort(), real=endpoint)
    whole.port.telemetry |= everything()

    def connected() -> socket.socket:
        one = socket.socket(type=socket.SOCK_DGRAM if kind == "udpin" else socket.SOCK_STREAM)
        stack.enter_context(one)
        one.settimeout(PATIENCE_S)
        one.connect(("127.0.0.1", endpoint.port))
        return one

    def is_full() -> bool:
        whole.run(0.02)
        return len(whole.gateway.clients) == MAX_PEERS

    def is_stopped() -> bool:
        new.sendall(frame_of(HEARTBEAT) + frame_of(STOP))
        whole.run(0.02)
        return bool(whole.port.stops)

    with ExitStack() as stack:
        stack.callback(whole.close)
        for _ in range(MAX_PEERS):
            connected().sendall(frame_of(HEARTBEAT))
        until(is_full)
        new = connected()
        until(is_stopped)
        whole.port.stops[0](whole.port.accepted)
        whole.run(0.04)
        (ack,) = acks(mavlink.MAVLink(None).parse_buffer(new.recv(1000)))
        assert ack == (185, ACCEPTED)
        assert len(whole.gateway.clients) == MAX_PEERS


def test_emergency_stop_waits_for_no_transfer_and_no_upload(whole: WholeGateway) -> None:
    sent(whole, ARM, "a")
    whole.send(MissionCount(1, 1, 100, 0), "a")
    whole.send(mavlink.MAVLink_param_request_list_message(1, 1), "a")
    whole.run(0.04)
    assert whole.port.waiting
    for count in range(1, 30):  # however often, and in the same round
        whole.send(STOP, "a")
        whole.run(0.02)
        assert len(whole.port.stops) == count


def test_mission_of_10_000_items_is_refused_at_once(whole: WholeGateway) -> None:
    sent(whole, MissionCount(1, 1, 10_000, 0))
    assert isinstance(whole.port.performed[-1], AnnounceItems)
    whole.port.refuse(Reason.MISSION_TOO_LONG)
    whole.run(0.04)
    (ack,) = whole.sent_to("a", "MISSION_ACK")
    assert ack.type in (mavlink.MAV_MISSION_NO_SPACE, mavlink.MAV_MISSION_ERROR)
    assert "mission" in words(whole.sent_to("a", "STATUSTEXT"))
    for item in line_of(300):
        whole.send(item)
    whole.run(0.5)
    assert len(whole.port.performed) == 1


def test_upload_that_stops_gives_way_to_that_of_another_client(whole: WholeGateway) -> None:
    sent(whole, MissionCount(1, 1, 3, 0), "a")
    whole.port.answer()
    sent(whole, ITEMS[0], "a")
    sent(whole, MissionCount(1, 1, 2, 0), "b", 254)
    assert [one.type for one in whole.sent_to("b", "MISSION_ACK")] == [mavlink.MAV_MISSION_DENIED]
    whole.run(9.0)
    assert [one.type for one in whole.sent_to("a", "MISSION_ACK")] == [
        mavlink.MAV_MISSION_OPERATION_CANCELLED
    ]
    sent(whole, MissionCount(1, 1, 2, 0), "b", 254)
    whole.port.answer()
    sent(whole, ITEMS[0], "b", 254)
    sent(whole, ITEMS[1], "b", 254)
    assert isinstance(whole.port.performed[-1], UploadMission)
    assert len(whole.port.performed[-1].mission.waypoints) == 1


def test_client_that_vanishes_ends_the_heartbeat_and_leaves_control(whole: WholeGateway) -> None:
    """Without it the robot acts as at the loss of any operator: GUIDED ends, AUTO goes on."""
    sent(whole, ARM, "a")
    whole.port.answer()
    whole.run(SILENCE_NS / 1e9)
    beats = whole.port.heartbeats
    assert beats >= 15
    whole.run(1.0)
    assert whole.port.heartbeats == beats
    sent(whole, command(400, 1), "b", 254)
    assert [name for _, name in whole.port.leases] == ["MAVLink 255", "MAVLink 254"]


def test_by_tcp_nothing_but_a_stop_is_taken_before_a_heartbeat(whole: WholeGateway) -> None:
    whole.endpoint.is_reliable = True
    upload = mavlink.MAVLink_mission_count_message(1, 1, 2, 0)
    for message in (ARM, CLEAR, command(192, -1, 1, 0, 0, 10, 20), upload, ITEMS[0]):
        sent(whole, message, "web")
    assert whole.port.performed == []
    assert whole.port.leases == []
    assert {result for _, result in results(whole, "web")} == {DENIED}
    assert "HEARTBEAT" in words(whole.sent_to("web", "STATUSTEXT"))
    sent(whole, STOP, "web")
    assert len(whole.port.stops) == 1
    sent(whole, HEARTBEAT, "web")
    sent(whole, ARM, "web")
    assert isinstance(whole.port.performed[-1], Arm)


def test_what_was_sent_while_the_process_was_stopped_is_dropped(whole: WholeGateway) -> None:
    sent(whole, ARM, "a")
    whole.port.answer()
    whole.port.performed.clear()
    whole.send(command(192, -1, 1, 0, 0, 10, 20), "a")
    whole.send(mavlink.MAVLink_manual_control_message(1, 0, 0, 900, 0, 0), "a")
    whole.send(STOP, "b", 254)
    whole.clock.advance(STALL_NS)
    whole.run(0.04)
    assert (whole.port.performed, whole.port.driven) == ([], [])
    assert len(whole.port.stops) == 1
    assert "stood still for 2.0 s" in words(whole.sent_to("a", "STATUSTEXT"))
    sent(whole, command(176, 1, 4), "a")
    assert whole.port.performed == [Hold()]


@each("kind", ["udpin", "tcpin"])
def test_what_waits_in_a_socket_after_a_stop_is_dropped(kind: str) -> None:
    endpoint: Any = opened(f"{kind}:127.0.0.1:0")
    whole = WholeGateway(CommandedPort(), real=endpoint)
    whole.port.telemetry |= everything()
    with ExitStack() as stack:
        stack.callback(whole.close)
        one = socket.socket(type=socket.SOCK_DGRAM if kind == "udpin" else socket.SOCK_STREAM)
        stack.enter_context(one)
        one.connect(("127.0.0.1", endpoint.port))

        def is_stopped() -> bool:
            whole.run(0.02)
            return bool(whole.port.stops)

        def has_performed() -> bool:
            whole.run(0.02)
            return bool(whole.port.performed)

        waits = [HEARTBEAT, ARM, *(command(176, 1, mode) for mode in range(40)), STOP]
        for message in waits:
            one.sendall(frame_of(message))
        whole.clock.advance(STALL_NS)
        until(is_stopped)
        whole.run(0.1)
        assert (whole.port.performed, whole.port.leases) == ([], [])
        assert len(whole.port.stops) == 1
        one.sendall(frame_of(ARM))
        until(has_performed)
        assert whole.port.performed == [Arm()]


def test_flood_after_a_stop_of_the_process_is_not_old_for_ever(whole: WholeGateway) -> None:
    whole.clock.advance(STALL_NS)
    received = whole.gateway.received

    def receive_again(left: int) -> None:
        received(whole.endpoint, [Arrival("a", frame_of(ARM), is_loopback=True)])
        if left and not whole.port.performed:
            whole.loop.call_soon(receive_again, left - 1)

    whole.loop.call_soon(receive_again, 2 * MAX_OLD_TURNS)
    whole.run(0.02)
    assert whole.port.performed == [Arm()]


def test_error_in_a_callback_ends_the_gateway(whole: WholeGateway) -> None:
    def broken() -> list[Any]:
        raise LookupError("a defect")

    whole.port.new_texts = broken  # type: ignore[method-assign]
    with pytest.raises(LookupError, match="a defect"):
        whole.run(0.2)


def test_no_room_for_connections_does_not_end_the_gateway(whole: WholeGateway) -> None:
    full = {"message": "socket.accept() out of system resource", "exception": OSError(24, "full")}
    whole.loop.call_exception_handler(full | {"socket": None})
    sent(whole, ARM)
    assert whole.port.performed == [Arm()]


KEY = b"k" * 32
DAY_NS = (EPOCH_S + 86_400) * 10**9


class SignedGateway(WholeGateway):
    """A gateway with a key, and a client that signs."""

    def __init__(self, policy: Policy, peer_is_loopback: bool = False) -> None:
        ring = KeyRing(key=(SigningKey(secret=KEY.hex()),))
        now: list[Any] = [self]
        guard = SigningGuard(
            lambda: DAY_NS + (now[0].clock.now_ns() if hasattr(now[0], "clock") else 0),
            ring,
            {"test": policy},
        )
        super().__init__(CommandedPort(), guard=guard)
        self.endpoint.is_loopback = peer_is_loopback
        self.port.telemetry |= everything()
        self.signer = mavlink.MAVLink(None, 255, 190)
        self.signer.signing.secret_key, self.signer.signing.sign_outgoing = KEY, True

    def signed(self, message: MavMessage, ahead_s: float = 0.0) -> bytes:
        """Return a frame as it is signed on a computer whose clock is ahead."""
        now = 86_400 * PER_S + self.clock.now_ns() // STAMP_NS + 1
        self.signer.signing.timestamp = now + round(ahead_s * PER_S)
        frame: bytes = message.pack(self.signer)
        return frame


@each("policy", list(Policy))
def test_recorded_frames_of_the_owner_do_not_act_again(policy: Policy) -> None:
    whole = SignedGateway(policy)
    whole.run(1.0)
    frame = whole.signed(ARM)
    whole.endpoint.deliver("a", frame)
    whole.run(0.04)
    assert whole.port.performed == [Arm()]
    whole.port.answer()
    for peer in ("a", "b"):
        whole.run(2.0)
        whole.endpoint.deliver(peer, frame)
        whole.run(0.04)
    assert whole.port.performed == [Arm()]
    whole.close()


@each("policy", [Policy.REQUIRE, Policy.LOOPBACK])
def test_unsigned_stranger_at_the_address_of_the_owner_commands_nothing(policy: Policy) -> None:
    whole = SignedGateway(policy)
    whole.run(1.0)
    whole.endpoint.deliver("a", whole.signed(ARM))
    whole.run(0.04)
    whole.port.answer()
    whole.port.performed.clear()
    stream = mavlink.MAVLink_manual_control_message(1, 0, 0, 900, 0, 0)
    for message in (command(176, 1, 15), CLEAR, command(32100, 0), STOP, stream):
        sent(whole, message, "a")
    assert (whole.port.performed, whole.port.driven, whole.port.stops) == ([], [], [])
    whole.run(SILENCE_NS / 1e9 - 1.0)
    sent(whole, HEARTBEAT, "a")  # does not keep the owner alive
    whole.run(1.0)
    assert whole.face.vehicle.control.owner is None
    whole.close()


@each("policy", list(Policy))
@each(("ahead_s", "reason"), [(61.0, "ahead of"), (3e6, "ahead of"), (-61.0, "old"), (-8e4, "old")])
def test_signed_stop_acts_whatever_the_clock_and_nothing_else(
    policy: Policy, ahead_s: float, reason: str
) -> None:
    whole = SignedGateway(policy)
    whole.run(1.0)
    stream = mavlink.MAVLink_manual_control_message(1, 0, 0, 900, 0, 0)
    for message in (HEARTBEAT, ARM, CLEAR, command(400, 0, 21196), command(185, 0.5), stream):
        whole.endpoint.deliver("a", whole.signed(message, ahead_s))
        whole.run(0.04)
    assert (whole.port.performed, whole.port.leases, whole.port.stops) == ([], [], [])
    whole.endpoint.deliver("a", whole.signed(STOP, ahead_s))
    whole.run(0.04)
    assert len(whole.port.stops) == 1
    whole.port.stops[0](whole.port.accepted)
    whole.run(0.04)
    assert results(whole, "a") == [(185, ACCEPTED)]
    assert reason in words(whole.sent_to("a", "STATUSTEXT"))
    assert whole.gateway._guard._clock.newest < 86_500 * PER_S  # it sets no clock
    whole.endpoint.deliver("b", whole.signed(ARM))
    whole.run(0.04)
    assert whole.port.performed == [Arm()]
    whole.close()


def test_replays_of_a_signed_stop_stop_again_and_are_told_once_a_second() -> None:
    whole = SignedGateway(Policy.REQUIRE)
    whole.run(1.0)
    recorded = whole.signed(STOP)
    whole.endpoint.deliver("a", recorded)
    whole.run(1.0)
    assert whole.sent_to("a", "STATUSTEXT") == []
    whole.endpoint.deliver("a", whole.signed(ARM))
    whole.run(0.04)
    whole.port.answer()
    for _ in range(100):  # in 4 seconds, from another place
        whole.endpoint.deliver("b", recorded)
        whole.run(0.04)
    assert len(whole.port.stops) == 101
    texts = words(whole.sent_to("a", "STATUSTEXT"))  # the operator is told, too
    assert texts.count("a replay") in (4, 5)
    assert "(1 so far)" in texts
    assert "(76 so far)" in texts
    (link,) = (client.link for client in whole.gateway.clients if client.peer == "b")
    assert link.signing.refused == 100
    assert whole.face.vehicle.control.owner is None  # a replay keeps no operator in control
    whole.close()


def test_stop_with_a_wrong_signature_does_nothing() -> None:
    whole = SignedGateway(Policy.REQUIRE)
    whole.signer.signing.secret_key = b"w" * 32
    for ahead_s in (0.0, 61.0):
        whole.endpoint.deliver("a", whole.signed(STOP, ahead_s))
        whole.run(0.04)
    assert whole.port.stops == []
    whole.close()
