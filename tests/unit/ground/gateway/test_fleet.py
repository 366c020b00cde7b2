"""Two robots behind one port, and what a slow line gets."""

from itertools import cycle, islice

from gateways.mavlink.clients import ClientLink
from gateways.mavlink.gateway_verb import LOW_RATE_BYTES_S
from gateways.mavlink.mavlink_dialect import mavlink
from gateways.mavlink.services import face_of
from gateways.mavlink.signing import EPOCH_S, SigningGuard
from ground.user.mavlink_keys import KeyRing, new_key
from tests.support.gateway.fake_port import CLIENT, Bench
from tests.support.gateway.telemetry import everything

NUMBERS = (400, 176, 185, 192, 20, 300, 193, 178, 179, 246, 32100)
LOW_RATE_LIMIT = 4_500


def test_1000_commands_for_one_robot_never_reach_the_other() -> None:
    first, second = Bench(system=1), Bench(system=2)
    for bench in (first, second):
        bench.face = face_of(bench.vehicle)
        bench.port.telemetry |= everything()
        bench.face.due(0)
        bench.vehicle.outbox.take()
    for turn, number in enumerate(islice(cycle(NUMBERS), 1_000)):
        sender = CLIENT._replace(system=100 + turn % 50)
        command = mavlink.MAVLink_command_long_message(2, 1, number, 0, 1, 15, 0, 0, 0, 0, 0)
        command._header.seq = turn & 0xFF
        assert first.send(command, sender) == []
        second.send(command, sender)
    assert (first.port.performed, first.port.stops, first.port.leases) == ([], [], [])
    assert first.vehicle.control.owner is None
    assert second.port.stops
    assert second.port.leases


def test_low_rate_profile_fits_57600_baud_with_signatures() -> None:
    bench = Bench()
    bench.face = face_of(bench.vehicle)
    bench.port.telemetry |= everything()
    bench.face.join(CLIENT.client, LOW_RATE_BYTES_S)
    ring = KeyRing(key=(new_key(),))
    guard = SigningGuard(lambda: EPOCH_S * 10**9 + bench.now_ns, ring)
    link = ClientLink(CLIENT.client, "radio", 0)
    bench.after(2.0)
    sizes = [len(link.encode(1, message, guard)) for message in bench.after(20.0)]
    assert 2_000 < sum(sizes) / 20.0 <= LOW_RATE_LIMIT
