"""The station on a real bus: its commands, every robot, and each kind of loss."""

import threading
from collections.abc import Callable, Iterator
from statistics import median
from time import monotonic, thread_time
from typing import Any

import pytest

from checks.harness.messages import make
from checks.harness.relays import TcpProxy
from checks.harness.until import PATIENCE_S, until
from ground.client.connection import Common
from ground.console.app_commands import AppCommand
from ground.console.parser import read
from ground.station import fleet
from ground.station.link.loss import LossKind
from ground.station.robot.robot_model import ALL, WATCHED
from protocol.topics import COMMAND, LEASE_SERVICE, ODOMETRY, STATUS, STOP, SUMMARIES, Role
from protocol.wire.enums import AckResult, Command, LeaseAction, Mode, Vehicle
from protocol.wire.messages import CommandAck, CommandRequest, LeaseRequest
from tests.support.ground.station import Robot
from tests.support.networks import Net, net
from tests.support.stacks import Lively, Paced, Watching
from tests.support.stacks import watching as lively_watching

pytestmark = pytest.mark.stack


def typed(words: str) -> Any:
    """Return the command of `words`, as they are typed in the app."""
    operation = read(words)
    assert not isinstance(operation, AppCommand)
    return operation


def done(seen: Watching, words: str, *, moves: bool = True) -> str:
    """Type it, and wait for what comes of it."""
    assert seen.station.queue.submit(words, typed(words), moves=moves)
    seen.until(lambda: not seen.station.queue.busy)
    return seen.station.queue.last


def machine(stack: Lively) -> Callable[[], Vehicle]:
    return lambda: Vehicle(stack.vehicle.state.machine.vehicle)


def test_typed_commands_take_the_lease_and_log_answers() -> None:
    with Paced() as stack, stack.going(), lively_watching(stack) as seen:
        stack.operator = False
        seen.until_ready()
        assert done(seen, "arm").startswith("arm: ok ")
        seen.until(lambda: seen.station.lease.ours)
        assert stack.vehicle.lease.allows(seen.station.lease.holder)
        assert not stack.vehicle.lease.allows("somebody else")
        assert done(seen, "goal 3 2").startswith("goal 3 2: ")
        seen.until(lambda: stack.vehicle.commands.goal_id != 0)
        assert machine(stack)() is Vehicle.ACTIVE


def test_an_app_that_hangs_loses_the_robot_its_operator_and_the_lease() -> None:
    with Lively() as stack, stack.going(), lively_watching(stack) as seen:
        seen.until_ready()
        done(seen, "arm")
        done(seen, "goal 5 2")
        seen.until(lambda: stack.vehicle.state.machine.mode == Mode.GUIDED)
        until(lambda: machine(stack)() is Vehicle.FAILSAFE)  # the station is not polled
        until(lambda: stack.vehicle.lease.allows("somebody else"))
        seen.until(lambda: not seen.station.lease.held)
        assert seen.station.log.find("lapsed")


def test_two_stations_one_commands_and_the_other_may_still_stop_it() -> None:
    with (
        Paced() as stack,
        stack.going(),
        lively_watching(stack) as anna,
        lively_watching(stack, name="ben") as ben,
    ):
        anna.until_ready()
        done(anna, "arm")

        def bens() -> bool:
            anna.turn()
            return ben.station.lease.others

        ben.until(bens)
        assert ben.station.lease.name == "anna"
        assert not ben.station.queue.submit("arm", typed("arm"))
        assert done(ben, "hold", moves=False).startswith("hold: ok ")
        ben.station.estop()
        ben.until(lambda: ben.station.log.find("E-STOP acknowledged by r1 after"))
        assert machine(stack)() is Vehicle.EMERGENCY_STOP


def test_two_programs_of_one_person_share_the_lease() -> None:
    with (
        Paced() as stack,
        stack.going(),
        lively_watching(stack) as first,
        lively_watching(stack) as second,
    ):
        first.until_ready()
        done(first, "arm")
        done(first, "goal 5 2")
        first.until(lambda: stack.vehicle.state.machine.mode == Mode.GUIDED)

        def settled() -> bool:
            first.turn()
            return second.station.ready and not second.station.queue.busy

        second.until(settled)
        assert second.station.lease.ours
        assert second.station.loss() is None
        assert second.station.queue.submit("goal 3 2", typed("goal 3 2"))
        second.until(settled)
        assert second.station.queue.last.startswith("goal 3 2: ok ")
        first.until(lambda: first.station.log.find("r1: goal 5.0 2.0 replaced by the goal 3.0 2.0"))
        assert not second.station.log.find("refused")


def test_e_stop_repeats_until_a_lost_robot_returns() -> None:
    with Lively() as stack, stack.going(), lively_watching(stack) as seen:
        seen.until_ready()
        with stack.halted():
            stack.kill("robot")
        seen.station.estop()
        seen.until(lambda: len(seen.station.log.find("not acknowledged for")) >= 2)
        with stack.halted():
            stack.start("robot")
        seen.until(lambda: seen.station.log.find("E-STOP acknowledged by r1 after"))
        assert machine(stack)() is Vehicle.EMERGENCY_STOP


def test_hung_robot_obeys_the_e_stop_when_it_resumes() -> None:
    with Lively() as stack, stack.going(), lively_watching(stack) as seen:
        seen.until_ready()
        stack.hung = True
        seen.station.estop()
        seen.until(lambda: seen.station.log.find("not acknowledged for"))
        stack.hung = False
        seen.until(lambda: seen.station.log.find("E-STOP acknowledged"))
        assert machine(stack)() is Vehicle.EMERGENCY_STOP


def test_e_stop_does_not_block_and_logs_its_latency() -> None:
    with Lively() as stack, stack.going(), lively_watching(stack) as seen:
        seen.until_ready()
        cost_ms: list[float] = []
        for _ in range(5):
            began_s = thread_time()
            seen.station.estop()
            cost_ms.append((thread_time() - began_s) * 1e3)
            seen.until(lambda: not seen.station.stopping)
        assert median(cost_ms) < 5.0
        texts = [line.text for line in seen.station.log.find("E-STOP acknowledged")]
        took_ms = [float(text.split(" after ")[1].split(" ms")[0]) for text in texts]
        assert len(took_ms) == 5
        assert all(took > 0.0 for took in took_ms)


@pytest.mark.realtime
def test_close_releases_the_lease_within_two_seconds() -> None:
    with Lively() as stack, stack.going(), lively_watching(stack) as seen:
        seen.until_ready()
        done(seen, "arm")
        began_s = monotonic()
        seen.loop.run_until_complete(seen.station.close())
        assert monotonic() - began_s < 2.0
        assert stack.vehicle.lease.allows("somebody else")
    with Lively() as stack, stack.going(), lively_watching(stack) as seen:
        seen.until_ready()
        done(seen, "arm")
        stack.hung = True
        seen.station.estop()
        began_s = monotonic()
        seen.loop.run_until_complete(seen.station.close())
        assert monotonic() - began_s < 2.2


def test_robot_accepts_others_after_the_station_closes() -> None:
    with Lively() as stack, stack.going():
        with lively_watching(stack) as seen:
            seen.until_ready()
            done(seen, "arm")
        disarm = make(CommandRequest, request_id=7, command=Command.COMPONENT_ARM_DISARM)
        answer = stack.ground.ask(COMMAND, disarm, PATIENCE_S)
        assert isinstance(answer, CommandAck)
        assert answer.result == 0


@pytest.fixture
def network() -> Iterator[Net]:
    with net("router") as made:
        made.robot.announce()
        yield made


@pytest.fixture
def watching(network: Net) -> Iterator[Watching]:
    seen = Watching(network.ground, Common(network=network.ground.network, robot="r1"), "anna")
    try:
        yield seen
    finally:
        seen.close()


def names(seen: Watching) -> list[str]:
    return [entry.robot for entry in seen.station.roster()]


def come_and_go(network: Net, watching: Watching, name: str) -> None:
    with network.opened(Role.ROBOT, name) as robot:
        robot.announce()
        watching.until(lambda: watching.station.present.has(name, Role.ROBOT))
    watching.until(lambda: not watching.station.present.has(name, Role.ROBOT))


def test_robot_that_appears_is_shown_and_can_be_stopped(network: Net, watching: Watching) -> None:
    stops: list[bytes] = []
    robot, messages = network.join(Role.ROBOT, "r2"), Robot("r2", x_m=3.0)
    robot.stream(STOP, lambda _key, frame, _at: stops.append(frame), "r2")
    odometry = robot.publisher(SUMMARIES[ODOMETRY.path])
    status = robot.publisher(SUMMARIES[STATUS.path])
    robot.announce()

    def shown() -> bool:
        odometry.put(messages.odometry())
        status.put(messages.status())
        return [other.name for other in watching.station.scene().others] == ["r2"]

    watching.until(shown)
    assert not stops
    watching.station.estop("r2")
    watching.until(lambda: stops)


def test_robot_that_flaps_leaves_nothing_behind(network: Net, watching: Watching) -> None:
    come_and_go(network, watching, "r2")
    threads = threading.active_count()
    for _ in range(20):
        come_and_go(network, watching, "r2")
    assert set(names(watching)) == {"r1", "r2"}
    assert len(network.ground._mailboxes) == len(ALL) + len(WATCHED)
    assert threading.active_count() <= threads + 4
    assert len(watching.station.log) < 80


def test_subscriptions_of_replaced_robots_end(
    network: Net, watching: Watching, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = 20
    monkeypatch.setattr(fleet, "KEPT_NS", 0)
    monkeypatch.setattr(fleet, "MAX_ROBOTS", few)
    for number in range(few + 10):
        come_and_go(network, watching, f"x{number}")
    assert len(names(watching)) == few
    assert len(network.ground._mailboxes) == len(ALL) + (few - 1) * len(WATCHED)


def test_dead_robot_behind_a_router_is_reported_and_returns() -> None:
    with Lively(router=True) as stack, stack.going(), lively_watching(stack) as seen:
        seen.until_ready()
        with stack.halted():
            stack.kill("robot")
        seen.until_lost(LossKind.PROCESS_DEAD)
        with stack.halted():
            stack.start("robot")
        seen.until_ready()
        assert seen.kinds() == ["ROBOT DEAD"]
        assert seen.station.restarts(Role.ROBOT) == 1
        assert seen.station.log.find("is back after")


def test_the_robot_that_is_the_hub_itself_is_dead_and_comes_back() -> None:
    with Lively() as stack, stack.going(), lively_watching(stack) as seen:
        seen.until_ready()
        with stack.halted():
            stack.kill("robot")
        seen.until_lost(LossKind.PROCESS_DEAD)
        with stack.halted():
            stack.start("robot")
        seen.until_ready()
        assert seen.kinds() == ["ROBOT DEAD"]


@pytest.mark.parametrize("router", [False, True], ids=["hub", "router"])
def test_stopped_loop_with_a_live_token_is_hung(router: bool) -> None:
    with Lively(router=router) as stack, stack.going(), lively_watching(stack) as seen:
        seen.until_ready()
        stack.hung = True
        seen.until_lost(LossKind.HUNG)
        assert seen.station.present.has("r1", Role.ROBOT)
        stack.hung = False
        seen.until_ready()
        assert seen.kinds() == ["ROBOT HUNG"]
        assert seen.station.restarts(Role.ROBOT) == 0


def test_hung_loop_differs_from_a_lost_link_without_peers() -> None:
    with Lively() as stack, stack.going(), lively_watching(stack) as seen:
        seen.until_ready()
        with stack.halted():
            stack.kill("plant")
            stack.hung = True
        seen.until_lost(LossKind.HUNG)


def test_a_plant_that_stops_leaves_the_robot_without_senses() -> None:
    with Lively() as stack, stack.going(), lively_watching(stack) as seen:
        seen.until_ready()
        with stack.halted():
            stack.kill("plant")
        seen.until_lost(LossKind.SENSES_STALE)
        loss = seen.station.loss()
        assert loss is not None
        assert "no plant" in loss.cause
        with stack.halted():
            stack.start("plant")
        seen.until_ready()
        assert seen.station.restarts(Role.PLANT) == 1


def test_another_operators_lease_is_a_loss_until_it_is_given_back() -> None:
    with Lively() as stack, stack.going(), lively_watching(stack) as seen:
        seen.until_ready()
        asked(stack, LeaseAction.TAKE)
        seen.until_lost(LossKind.OTHER_OPERATOR)
        assert seen.station.lease.name == "ben"
        asked(stack, LeaseAction.RELEASE)
        seen.until_ready()
        assert seen.kinds() == ["OTHER OPERATOR"]


def asked(stack: Lively, action: LeaseAction) -> None:
    """Let another operator take the lease or give it back."""
    request = LeaseRequest(request_id=action + 1, action=action, name="ben")
    answer = stack.ground.ask(LEASE_SERVICE, request, PATIENCE_S)
    assert isinstance(answer, CommandAck)
    assert answer.result == AckResult.ACCEPTED


def test_lost_router_is_reported_and_reconnected() -> None:
    with Lively(router=True) as stack, stack.going(), lively_watching(stack) as seen:
        seen.until_ready()
        endpoint = stack._hub
        with stack.halted():
            stack._scopes["router"].close()
        seen.until_lost(LossKind.ROUTER_GONE)
        with stack.halted():
            stack._hub = endpoint
            stack._open("router", None)
        seen.until_ready()
        assert seen.kinds() == ["ROUTER GONE"]


@pytest.mark.parametrize("router", [False, True], ids=["hub", "router"])
def test_a_cut_cable_is_a_lost_link_and_nothing_else(router: bool) -> None:
    with (
        Lively(router=router) as stack,
        stack.going(),
        TcpProxy(stack._hub) as cable,
        lively_watching(stack, cable.endpoint) as seen,
    ):
        seen.until_ready()
        cable.cut()
        seen.until_lost(LossKind.TRANSPORT)
        cable.restore()
        seen.until_ready()
        assert seen.kinds() == ["LINK LOST"]
        assert seen.station.restarts(Role.ROBOT) == 0
