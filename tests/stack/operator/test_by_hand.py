"""Missions, the lease and driving by hand, from a shell to a robot that drives in a world."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from ground.missions.files import read
from protocol.topics import MISSION
from protocol.wire.enums import MissionState, Mode, Vehicle
from protocol.wire.messages import MissionStatus
from protocol.wire.reasons import Reason
from tests.support.stack.processes import Crew, Witness, departs
from tests.support.until import until

pytestmark = pytest.mark.stack

TRIES = 6
TOUR = """
[[waypoint]]
x_m = 0.9
y_m = 2.3
hold_s = 0.3

[[waypoint]]
x_m = 0.6
y_m = 1.9

[fence.circle]
x_m = 1
y_m = 2
radius_m = 2
"""


@contextmanager
def scene() -> Iterator[tuple[Crew, Witness]]:
    """Start a robot in standby in a world, and an observer."""
    with Crew() as crew:
        crew.robot()
        crew.plant()
        with Witness(crew.endpoint) as witness:
            witness.ready()
            yield crew, witness


def done(crew: Crew, *words: str, code: int = 0) -> str:
    """Run a verb, require its exit code, and return its output."""
    ended, said = crew.run(*words)
    assert ended == code, said
    assert "Traceback" not in said
    return said


def late(witness: Witness) -> bool:
    """Has it stopped because this machine is busy with other things?"""
    status = witness.status
    return status.vehicle == Vehicle.FAILSAFE and status.vehicle_reason == Reason.BUDGET


def test_a_mission_is_driven_from_a_file_and_comes_back_as_one(tmp_path: Path) -> None:
    path, back = tmp_path / "tour.toml", tmp_path / "back.toml"
    path.write_text(TOUR)
    with scene() as (crew, witness):
        mission = witness.bus.mailbox(MISSION, "r1")

        def over() -> bool:
            newest = mission.latest()
            status = newest[0] if newest else None
            return isinstance(status, MissionStatus) and status.state == MissionState.DONE

        done(crew, "mission", "upload", str(path))
        for _ in range(TRIES):
            done(crew, "arm")
            done(crew, "mission", "start")
            until(lambda: over() or late(witness), 30.0, "the mission is done")
            if over():
                break
        assert done(crew, "mission", "status") == "done, item 2 of 2\n"
        assert "outside of the fence" in done(crew, "goto", "5", "2", code=1)
        done(crew, "mission", "download", str(back))
    assert read(back) == read(path)


def test_second_operator_sees_the_first_and_may_stop_the_robot() -> None:
    with scene() as (crew, witness):
        goto = departs(crew, witness, "goto", "5.4", "2")
        assert "another operator commands the robot: " in done(crew, "hold", code=1)
        assert "commands r1" in done(crew, "lease", "show")
        done(crew, "estop")
        until(witness.standing)
        assert goto.ends() == 1
        assert done(crew, "lease", "show") == "no operator holds the lease\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_teleop_robot_stops_when_its_operator_exits(number: signal.Signals) -> None:
    with scene() as (crew, witness):
        hand = crew.dialling("teleop", "0.3", "20")
        until(lambda: witness.truth.speed_m_s > 0.1)
        assert witness.status.mode == Mode.MANUAL
        hand.send(number)
        until(witness.standing, 2.0, "standing")
        assert hand.ends() == (130 if number is signal.SIGINT else -number)
