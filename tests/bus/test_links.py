"""Links: opening, one process per role, processes that die, and samples that are lost."""

import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from time import monotonic_ns
from typing import Literal

import pytest

from checks.harness.relays import TcpProxy
from checks.harness.until import PATIENCE_S, until
from protocol.bus import certificate, session
from protocol.bus.bus import Bus, DuplicateWatch, NameTakenError, claim, open_bus
from protocol.bus.link_faults import LinkFaults
from protocol.bus.network import LEASE_MS, Network
from protocol.bus.publisher import Publisher
from protocol.topics import CLOCK, WHEELS, Role
from protocol.wire.codec import decode
from protocol.wire.messages import WheelTicks
from runtime.errors import (
    EndpointError,
    EndpointInUseError,
    LocalError,
    NoPeerError,
    PeerHangsError,
    UserError,
)
from runtime.units import NS_PER_MS as MS
from tests.support.networks import TOPOLOGIES, Topology, net

ANY_PORT = Network(mode="peer", listen=("tcp/127.0.0.1:0",))
NOBODY_THERE = "tcp/127.0.0.1:1"


def test_the_port_behind_a_zero_is_known() -> None:
    with open_bus(ANY_PORT, Role.ROBOT, "r1") as bus:
        assert bus.locator().startswith("tcp/127.0.0.1:")
        assert not bus.locator().endswith(":0")


def test_bus_without_a_listener_has_no_locator() -> None:
    with open_bus(Network(mode="peer"), None, "r1") as bus, pytest.raises(LocalError):
        bus.locator()


def test_an_endpoint_in_use_is_named() -> None:
    with open_bus(ANY_PORT, Role.ROBOT, "r1") as bus:
        taken = bus.locator()
        with pytest.raises(EndpointInUseError, match=taken):
            open_bus(Network(mode="peer", listen=(taken,)), Role.ROBOT, "r1")


def test_missing_peer_error_names_endpoint_and_remedy() -> None:
    network = Network(mode="client", connect=(NOBODY_THERE,), connect_timeout_s=0.05)
    with pytest.raises(NoPeerError, match=rf"{NOBODY_THERE} .*waited 0\.05 s.* start") as caught:
        open_bus(network, Role.PLANT, "r1")
    assert caught.value.exit_code == 2


def test_silent_listener_is_reported_as_hung(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "SLOW_DIAL_S", 0.2)
    monkeypatch.setattr(certificate, "HANDSHAKE_S", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as mute:
        endpoint = f"tcp/127.0.0.1:{mute.getsockname()[1]}"
        network = Network(mode="client", connect=(endpoint,), connect_timeout_s=0.2)
        with pytest.raises(
            PeerHangsError, match=f"listens at {endpoint} but does not answer.*hangs"
        ):
            open_bus(network, Role.GROUND, "r1")


@pytest.mark.parametrize("mode", ["client", "peer"])
def test_an_unknown_host_is_named(mode: Literal["client", "peer"]) -> None:
    unknown = ("tcp/no-such-host.invalid:7447",)
    if mode == "client":
        network = Network(mode=mode, connect=unknown, connect_timeout_s=0.05)
    else:
        network = Network(mode=mode, listen=unknown)
    with pytest.raises(UserError, match=unknown[0]) as caught:
        open_bus(network, Role.ROBOT, "r1")
    assert caught.value.exit_code == 2


def test_an_address_of_another_machine_cannot_be_listened_on() -> None:
    with pytest.raises(EndpointError, match=r"tcp/192\.0\.2\.1:7447") as caught:
        open_bus(Network(mode="peer", listen=("tcp/192.0.2.1:7447",)), None, "r1")
    assert ".rs" not in str(caught.value), "source locations of a library do not help a user"


def test_a_bad_robot_name_is_refused_before_anything_is_opened() -> None:
    with pytest.raises(UserError, match="robot name 'R 1'"):
        open_bus(ANY_PORT, Role.ROBOT, "R 1")


def test_a_client_waits_for_a_hub_that_starts_later() -> None:
    with open_bus(ANY_PORT, Role.ROBOT, "r1") as bus:
        endpoint = bus.locator()
    opened: list[str] = []

    def dial() -> None:
        network = Network(mode="client", connect=(endpoint,), connect_timeout_s=PATIENCE_S)
        with open_bus(network, Role.PLANT, "r1") as late:
            opened.append(late.zid)

    dialling = threading.Thread(target=dial)
    dialling.start()
    with open_bus(Network(mode="peer", listen=(endpoint,)), Role.ROBOT, "r1"):
        dialling.join(timeout=PATIENCE_S)
        assert opened


@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_watcher_always_sees_all_present_processes(topology: Topology) -> None:
    with net(topology) as bus:
        bus.ground.watch(lambda who, came: None)
        bus.robot.announce()
        bus.plant.announce()
        until(lambda: len(bus.ground.present()) == 2)
        assert {len(bus.ground.present()) for _ in range(200)} == {2}


@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_presence_query_always_returns_all_processes(topology: Topology) -> None:
    with net(topology) as bus:
        bus.robot.announce()
        bus.plant.announce()
        until(lambda: len(bus.ground.present()) == 2)
        assert {len(bus.ground.present()) for _ in range(200)} == {2}


@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_presence_follows_the_process(topology: Topology) -> None:
    with net(topology) as bus:
        seen: list[tuple[str, str, bool]] = []
        bus.ground.watch(lambda who, came: seen.append((who.robot, who.role, came)))
        bus.robot.announce()
        bus.plant.announce()
        until(lambda: len(bus.ground.present()) == 2)
        assert {(who.robot, who.role) for who in bus.ground.present()} == {
            ("r1", "robot"),
            ("r1", "plant"),
        }
        bus.plant.close()
        until(lambda: ("r1", "plant", False) in seen)
        assert [who.zid for who in bus.ground.present()] == [bus.robot.zid]


def test_bus_without_a_role_cannot_announce() -> None:
    with net() as bus, pytest.raises(LocalError, match="without a role"):
        bus.join(None).announce()


LEFT_OPEN = """
from protocol.bus import session
from protocol.bus.bus import open_bus
from protocol.bus.network import LEASE_MS, Network
from protocol.bus import certificate
from protocol.topics import COMMAND, WHEELS, Role
bus = open_bus(Network(mode="peer", listen=("tcp/127.0.0.1:0",)), Role.ROBOT, "r1")
bus.mailbox(WHEELS)
bus.serve(COMMAND, lambda asked: None)
bus.announce()
raise SystemExit(3)
"""


def test_unclosed_bus_lets_the_process_exit_silently() -> None:
    ended = subprocess.run(
        [sys.executable, "-c", LEFT_OPEN],
        timeout=PATIENCE_S,
        capture_output=True,
        check=False,
        env={"RUST_LOG": "debug", "PYTHONPATH": ":".join(sys.path)},
    )
    assert (ended.returncode, ended.stdout) == (3, b""), ended.stderr.decode()


TICKS = WheelTicks(time_ns=1, seq=1, left=2, right=-3, bumper=0, expired=0)

ANNOUNCED = """
import sys
from protocol.bus.bus import open_bus
from protocol.bus.network import LEASE_MS, Network
from protocol.topics import Role
network = Network(mode="client", connect=(sys.argv[1],), prefix=sys.argv[2])
with open_bus(network, Role.GROUND, "r1") as bus:
    bus.announce()
    print("here", flush=True)
    sys.stdin.read()
"""


def test_presence_of_a_killed_process_ends_at_once() -> None:
    with net() as bus:
        gone: list[str] = []
        bus.robot.watch(lambda who, came: None if came else gone.append(who.role))
        with subprocess.Popen(
            [sys.executable, "-c", ANNOUNCED, bus.endpoint, bus.prefix],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={"PYTHONPATH": ":".join(sys.path)},
        ) as process:
            assert process.stdout is not None
            assert process.stdout.readline() == b"here\n"
            until(lambda: [who.role for who in bus.robot.present()] == ["ground"])
            process.kill()
            until(lambda: gone == ["ground"])
        assert bus.robot.present() == []


def test_restarted_hub_receives_from_old_publishers() -> None:
    with open_bus(Network(mode="peer", listen=("tcp/127.0.0.1:0",)), Role.ROBOT, "r1") as first:
        endpoint = first.locator()
        network = Network(mode="client", connect=(endpoint,))
        plant = open_bus(network, Role.PLANT, "r1")
    with plant:
        wheels = plant.publisher(WHEELS)
        with open_bus(Network(mode="peer", listen=(endpoint,)), Role.ROBOT, "r1") as second:
            ticks = second.mailbox(WHEELS)
            assert plant.await_matched([wheels], PATIENCE_S) == []
            wheels.put(TICKS)
            until(ticks.latest)


def hub(endpoint: str) -> Bus:
    return open_bus(Network(mode="peer", listen=(endpoint,)), Role.ROBOT, "r1")


def test_client_distinguishes_an_ended_from_a_hung_hub() -> None:
    with hub("tcp/127.0.0.1:0") as first:
        endpoint = first.locator()
        client = open_bus(Network(mode="client", connect=(endpoint,)), Role.GROUND, "r1")
        assert client.lost() == ""
    with client:
        until(lambda: client.lost() == f"the process at {endpoint} has ended")
        host, _, port = endpoint.removeprefix("tcp/").partition(":")
        with socket.create_server((host, int(port))):  # takes the call, as a stopped one does
            assert client.lost().endswith("no longer answers: it is slow or hangs")


def test_a_publisher_knows_when_its_last_reader_has_left() -> None:
    with net() as bus:
        wheels = bus.plant.publisher(WHEELS)
        bus.ground.mailbox(WHEELS)
        assert bus.plant.await_matched([wheels], PATIENCE_S) == []
        bus.ground.close()
        until(lambda: not wheels.matched)


ANYWHERE = "tcp/127.0.0.1:0"


def router(scope: ExitStack, lease_ms: int = LEASE_MS) -> Network:
    network = Network(mode="router", listen=(ANYWHERE,), lease_ms=lease_ms)
    hub = scope.enter_context(open_bus(network, None, "r1"))
    return Network(mode="client", connect=(hub.locator(),))


def joined(scope: ExitStack, network: Network, role: Role, robot: str) -> Bus:
    return scope.enter_context(open_bus(network, role, robot))


@pytest.mark.parametrize("role", [Role.ROBOT, Role.PLANT])
def test_a_second_process_of_one_name_is_refused_by_name(role: Role) -> None:
    with ExitStack() as scope:
        network = router(scope)
        first, second = (joined(scope, network, role, "r1") for _ in range(2))
        claim(first, ["r1"])
        with pytest.raises(NameTakenError, match=f"a {role.value} for r1 already.*{first.zid}"):
            claim(second, ["r1"])


def test_other_names_and_other_roles_are_welcome() -> None:
    with ExitStack() as scope:
        network = router(scope)
        claim(joined(scope, network, Role.ROBOT, "r1"), ["r1"])
        claim(joined(scope, network, Role.ROBOT, "r2"), ["r2"])
        claim(joined(scope, network, Role.PLANT, "r1"), ["r1", "r2"])


def test_a_plant_of_several_robots_takes_each_name() -> None:
    with ExitStack() as scope:
        network = router(scope)
        claim(joined(scope, network, Role.PLANT, "r1"), ["r1", "r2"])
        with pytest.raises(NameTakenError, match="r2"):
            claim(joined(scope, network, Role.PLANT, "r2"), ["r2"])


def test_a_late_answer_does_not_look_as_if_nobody_were_there() -> None:
    """On a line whose bytes need two seconds; a busy machine needs as long."""
    names = [f"robot-{number:03d}" for number in range(100)]
    with ExitStack() as scope:
        network = router(scope, lease_ms=round(PATIENCE_S * 1000))
        claim(joined(scope, network, Role.PLANT, "r1"), names)
        slow = scope.enter_context(TcpProxy(network.connect[0], 5_000.0)).endpoint
        late = joined(scope, replace(network, connect=(slow,)), Role.PLANT, "r2")
        assert [one.robot for one in late.present()] == names


def test_a_name_is_free_again_when_its_process_is_gone() -> None:
    with ExitStack() as scope:
        network = router(scope)
        with open_bus(network, Role.ROBOT, "r1") as first:
            claim(first, ["r1"])
        claim(joined(scope, network, Role.ROBOT, "r1"), ["r1"])


def test_later_duplicate_name_is_reported_while_present() -> None:
    """Reproduce a healed network partition: neither robot saw the other when it started."""
    with ExitStack() as scope:
        network = router(scope)
        first = joined(scope, network, Role.ROBOT, "r1")
        claim(first, ["r1"])
        twins = DuplicateWatch(first)
        for role, robot in ((Role.PLANT, "r1"), (Role.GROUND, "r1"), (Role.ROBOT, "r2")):
            joined(scope, network, role, robot).announce()
        second = joined(scope, network, Role.ROBOT, "r1")
        until(lambda: len(first.present()) == 4, what="all others are there")
        assert not twins
        second.announce()
        until(lambda: bool(twins), what="the second is there")
        second.close()
        until(lambda: not twins, what="the second is gone")


def test_a_second_that_was_there_before_is_seen_too() -> None:
    with ExitStack() as scope:
        network = router(scope)
        first, second = (joined(scope, network, Role.ROBOT, "r1") for _ in range(2))
        second.announce()
        twins = DuplicateWatch(first)
        until(lambda: bool(twins), what="the second is there")


class Heard:
    """The numbers of the ticks that came through, and when."""

    def __init__(self, bus: Bus) -> None:
        self.seqs: list[int] = []
        self.at_ns: list[int] = []
        self.dealt_with: list[str] = []
        bus.faults.after = self.dealt_with.append
        bus.stream(WHEELS, self._take)

    def _take(self, _key: str, frame: bytes, arrived_ns: int) -> None:
        message = decode(frame).message
        assert isinstance(message, WheelTicks)
        self.seqs.append(message.seq)
        self.at_ns.append(arrived_ns)


@contextmanager
def pair(trouble: LinkFaults | None) -> Iterator[tuple[Bus, Heard, Publisher[WheelTicks]]]:
    hub = Network(mode="peer", listen=("tcp/127.0.0.1:0",), trouble=trouble)
    with open_bus(hub, Role.ROBOT, "r1") as robot:
        heard = Heard(robot)
        leaf = Network(mode="client", connect=(robot.locator(),))
        with open_bus(leaf, Role.PLANT, "r1") as plant:
            wheels = plant.publisher(WHEELS)
            assert plant.await_matched([wheels], PATIENCE_S) == []
            yield robot, heard, wheels


def send(heard: Heard, wheels: Publisher[WheelTicks], *seqs: int) -> None:
    """Put them and wait until the line has dealt with them."""
    before = len(heard.dealt_with)
    for seq in seqs:
        wheels.put(WheelTicks(time_ns=0, seq=seq, left=0, right=0, bumper=0, expired=0))
    until(lambda: len(heard.dealt_with) == before + len(seqs))


def test_all_samples_arrive_without_faults() -> None:
    with pair(None) as (_, heard, wheels):
        send(heard, wheels, *range(50))
        assert heard.seqs == list(range(50))


def test_what_is_lost_is_lost_for_good_and_the_trouble_can_end() -> None:
    with pair(LinkFaults(loss=1.0)) as (robot, heard, wheels):
        send(heard, wheels, 1, 2, 3)
        robot.faults.disturb(None)
        send(heard, wheels, 4)
        assert heard.seqs == [4]


def test_what_is_late_comes_by_itself_when_it_is_due() -> None:
    with pair(LinkFaults(delay_ms=60)) as (_, heard, wheels):
        began_ns = monotonic_ns()
        send(heard, wheels, 1, 2)
        assert heard.seqs == []
        until(lambda: heard.seqs == [1, 2])
        assert heard.at_ns[0] - began_ns >= 60 * MS


def test_late_samples_are_lost_with_the_bus() -> None:
    with pair(LinkFaults(delay_ms=10_000)) as (_, heard, wheels):
        send(heard, wheels, 1)
    assert heard.seqs == []


def test_copies_and_swaps() -> None:
    with pair(LinkFaults(duplicate=1.0)) as (robot, heard, wheels):
        send(heard, wheels, 1)
        robot.faults.disturb(LinkFaults(reorder=1.0))
        send(heard, wheels, 2, 3)
        assert heard.seqs == [1, 1, 3, 2]


def test_faults_affect_only_named_topics_and_never_the_clock() -> None:
    with pair(LinkFaults(loss=1.0, paths=("sense/sonar",))) as (robot, heard, wheels):
        send(heard, wheels, 1)
        assert heard.seqs == [1]
        robot.faults.disturb(LinkFaults(loss=1.0))
        clock = robot.mailbox(CLOCK)
        robot.publisher(CLOCK).put_frame(b"\xfd")
        until(lambda: f"sidestep/r1/{CLOCK.path}" in heard.dealt_with)
        assert clock.rejected == 1, "it came as far as the mailbox"


def test_in_simulated_time_nothing_comes_before_it_is_let_go() -> None:
    with pair(LinkFaults(delay_ms=100)) as (robot, heard, wheels):
        robot.faults.by_hand = True
        now_ns = monotonic_ns()
        send(heard, wheels, 1)
        robot.faults.release(now_ns + 99 * MS)
        assert heard.seqs == []
        robot.faults.release(now_ns + 5_000 * MS)
        assert heard.seqs == [1]
