"""The station commands a real robot: lease, heart, requests, e-stop, and the end of it."""

from collections.abc import Callable
from statistics import median
from time import monotonic, thread_time

import pytest

from ground.client.connection import Common
from ground.client.link import Link
from ground.client.operations.session import Session
from ground.console.app_commands import AppCommand
from ground.console.parser import read
from ground.station.robot.background_requests import Job, JobResult
from protocol.bus.bus import Bus
from protocol.topics import COMMAND
from protocol.wire.enums import Command, Mode, Vehicle
from protocol.wire.messages import CommandAck, CommandRequest
from runtime.clock import WallClock
from tests.support.bus.lively import Lively, Watching, watching
from tests.support.until import PATIENCE_S, until

pytestmark = pytest.mark.stack


def typed(seen: Watching, words: str) -> Job:
    """Run `words` as the app's command line does, over the bus of the station."""
    bus = seen.station._bus
    assert isinstance(bus, Bus)
    operation = read(words)
    assert not isinstance(operation, AppCommand)

    def job() -> JobResult:
        link = Link(bus, Common(network=bus.network, robot="r1"), WallClock())
        outcome = operation.perform(Session(link, attended=True))
        return JobResult(outcome.ok, outcome.text)

    return job


def done(seen: Watching, words: str, *, moves: bool = True) -> str:
    """Type it, and wait for what comes of it."""
    assert seen.station.submit(words, typed(seen, words), moves=moves)
    seen.until(lambda: not seen.station.busy)
    return seen.station.last_command


def machine(stack: Lively) -> Callable[[], Vehicle]:
    return lambda: Vehicle(stack.vehicle.state.machine.vehicle)


def test_typed_commands_take_the_lease_and_log_answers() -> None:
    with Lively() as stack, stack.going(), watching(stack) as seen:
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
    with Lively() as stack, stack.going(), watching(stack) as seen:
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
        Lively() as stack,
        stack.going(),
        watching(stack) as anna,
        watching(stack, name="ben") as ben,
    ):
        anna.until_ready()
        done(anna, "arm")

        def bens() -> bool:
            anna.station.poll()
            return ben.station.lease.others

        ben.until(bens)
        assert ben.station.lease.name == "anna"
        assert not ben.station.submit("arm", typed(ben, "arm"))
        assert done(ben, "hold", moves=False).startswith("hold: ok ")
        ben.station.estop()
        ben.until(lambda: ben.station.log.find("E-STOP acknowledged by r1 after"))
        assert machine(stack)() is Vehicle.EMERGENCY_STOP


def test_two_programs_of_one_person_share_the_lease() -> None:
    with (
        Lively() as stack,
        stack.going(),
        watching(stack) as first,
        watching(stack) as second,
    ):
        first.until_ready()
        done(first, "arm")
        done(first, "goal 5 2")
        first.until(lambda: stack.vehicle.state.machine.mode == Mode.GUIDED)

        def settled() -> bool:
            first.station.poll()
            return second.station.ready and not second.station.busy

        second.until(settled)
        assert second.station.lease.ours
        assert second.station.loss() is None
        assert second.station.submit("goal 3 2", typed(second, "goal 3 2"))
        second.until(settled)
        assert second.station.last_command.startswith("goal 3 2: ok ")
        first.until(lambda: first.station.log.find("r1: goal 5.0 2.0 replaced by the goal 3.0 2.0"))
        assert not second.station.log.find("refused")


def test_e_stop_repeats_until_a_lost_robot_returns() -> None:
    with Lively() as stack, stack.going(), watching(stack) as seen:
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
    with Lively() as stack, stack.going(), watching(stack) as seen:
        seen.until_ready()
        stack.hung = True
        seen.station.estop()
        seen.until(lambda: seen.station.log.find("not acknowledged for"))
        stack.hung = False
        seen.until(lambda: seen.station.log.find("E-STOP acknowledged"))
        assert machine(stack)() is Vehicle.EMERGENCY_STOP


def test_e_stop_does_not_block_and_logs_its_latency() -> None:
    with Lively() as stack, stack.going(), watching(stack) as seen:
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
    with Lively() as stack, stack.going(), watching(stack) as seen:
        seen.until_ready()
        done(seen, "arm")
        began_s = monotonic()
        seen.station.close()
        assert monotonic() - began_s < 2.0
        assert stack.vehicle.lease.allows("somebody else")
    with Lively() as stack, stack.going(), watching(stack) as seen:
        seen.until_ready()
        done(seen, "arm")
        stack.hung = True
        seen.station.estop()
        began_s = monotonic()
        seen.station.close()
        assert monotonic() - began_s < 2.2


def test_robot_accepts_others_after_the_station_closes() -> None:
    with Lively() as stack, stack.going():
        with watching(stack) as seen:
            seen.until_ready()
            done(seen, "arm")
        disarm = CommandRequest(
            request_id=7, param1=0.0, param2=0.0, command=Command.COMPONENT_ARM_DISARM
        )
        answer = stack.ground.ask(COMMAND, disarm, PATIENCE_S)
        assert isinstance(answer, CommandAck)
        assert answer.result == 0
