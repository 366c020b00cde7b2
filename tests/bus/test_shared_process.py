"""Several robots in one process: what is their own, and what ends with the process."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import pytest

from checks.harness.crew import Crew, Witness
from checks.harness.in_process import reason_in
from checks.harness.processes import Running, command_request, is_accepted
from checks.harness.until import until
from ground.client.requests import RequestIds
from protocol.topics import COMMAND
from protocol.wire.enums import Command, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck
from protocol.wire.reasons import Reason
from robot.run import main
from runtime.errors import UserError
from tests.support.each import each


class Pair(NamedTuple):
    """Two robots in one process, as their bus shows them."""

    crew: Crew
    process: Running
    first: Witness
    second: Witness
    folder: Path


@pytest.fixture(params=[True])
def pair(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Pair]:
    lockstep: bool = request.param
    with Crew(lockstep=lockstep) as crew:
        places = ("--start", "0.6", "2", "0", "--start", "0.6", "2.6", "0")
        state = ("--state", str(tmp_path / "{id}"), *(("--lockstep",) * lockstep))
        process = crew.listening("robot", "--id", "r1,r2", *places, *state)
        process.says("robot r2: ready")
        crew.plant("--robots", "r1,r2")
        with Witness(crew.endpoint, "r1") as first, Witness(crew.endpoint, "r2") as second:
            first.ready()
            second.ready()
            yield Pair(crew, process, first, second, tmp_path)


def restart_of(witness: Witness) -> Message:
    """Ask a robot for a restart, and return its answer."""
    request = command_request(RequestIds().next(), Command.PREFLIGHT_REBOOT_SHUTDOWN, 1.0)
    answer = witness.bus.ask(COMMAND, request, 5.0, robot=witness.robot)
    assert isinstance(answer, CommandAck)
    return answer


def is_armed(crew: Crew, robot: str) -> bool:
    """Arm a robot; a busy machine may refuse it for want of senses."""
    return crew.run("arm", "--id", robot)[0] == 0


def vehicle_is(witness: Witness, vehicle: Vehicle) -> None:
    until(lambda: witness.status.vehicle == vehicle, vehicle.name)


def test_each_robot_of_a_process_has_its_own_stop_and_folder(pair: Pair) -> None:
    assert pair.crew.run("arm", "--id", "r2")[0] == 0
    assert pair.crew.run("estop", "--id", "r1")[0] == 0
    vehicle_is(pair.first, Vehicle.EMERGENCY_STOP)
    assert pair.second.status.vehicle == Vehicle.ACTIVE
    assert pair.crew.run("param", "set", "d_obs_m", "0.5", "--id", "r1")[0] == 0
    kept = {path.name: sorted(one.name for one in path.iterdir()) for path in pair.folder.iterdir()}
    assert {"robot.txt", "parameters.json", "stop.txt"} <= set(kept["r1"])
    assert "parameters.json" not in kept["r2"]
    assert "stop.txt" not in kept["r2"]


def test_each_robot_of_a_process_drives_to_its_own_goal(pair: Pair) -> None:
    code, said = pair.crew.run("goto", "1.0", "2.6", "--id", "r2")
    assert (code, "reached" in said) == (0, True), said
    assert pair.second.truth.x_m > 0.9
    assert pair.first.truth.x_m == pytest.approx(0.6)


def test_restart_of_a_robot_waits_for_the_others_of_its_process(pair: Pair) -> None:
    """Refuse it: an operator of one robot must not end the drive of another."""
    assert pair.crew.run("arm", "--id", "r2")[0] == 0
    assert reason_in(restart_of(pair.first)) == Reason.ARMED
    assert pair.crew.run("disarm", "--id", "r2")[0] == 0
    assert is_accepted(restart_of(pair.first))
    assert pair.process.ends() == 0
    assert "robot r2: ends for a restart on request" in pair.process.said


@pytest.mark.parametrize("pair", [True, False], ids=["lockstep", "wall"], indirect=True)
def test_all_robots_of_a_process_end_with_it(pair: Pair) -> None:
    witnesses = {"r1": pair.first, "r2": pair.second}
    for robot, witness in witnesses.items():
        until(partial(is_armed, pair.crew, robot), "armed")
        vehicle_is(witness, Vehicle.ACTIVE)
    pair.process.process.terminate()
    assert pair.process.ends() == 0
    for witness in witnesses.values():
        vehicle_is(witness, Vehicle.FAILSAFE)
        assert witness.speeds == (0, 0)


TWICE = ("--start", "0", "0", "0") * 2


@each(
    ("words", "reason"),
    [
        (("--id", "r1,r1"), "each robot needs a name of its own"),
        (("--id", "r1,"), "robot name ''"),
        (("--id", "r1,r2"), "once for each robot, in this order: 2 times, not 0"),
        (TWICE, "1 times, not 2"),
        (("--id", "r1,r2", *TWICE, "--state", "x"), "as in x/{id}"),
        (("--id", "r1,r2", *TWICE, "--stops", "x"), "as in x/{id}"),
        (("--id", "r1,r2", *TWICE, "--stop-at", "127.0.0.1:1"), "--stop-at HOST:PORT once for"),
        (("--id", "r1,r2", *TWICE, "--mcu"), "--mcu is for one robot"),
        (("--id", "r1,r2", *TWICE, "--realtime"), "--realtime is for one robot"),
    ],
)
def test_process_refuses_robots_that_cannot_share_it(words: tuple[str, ...], reason: str) -> None:
    with pytest.raises(UserError) as caught:
        main(words)
    assert reason in str(caught.value)
