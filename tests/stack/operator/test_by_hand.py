"""Missions, the lease and driving by hand, from a shell to a robot that drives in a world."""

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from ground.missions.files import read
from protocol.topics import MISSION
from protocol.wire.enums import MissionState, Mode
from protocol.wire.messages import MissionStatus
from tests.support.stack.processes import Crew, Witness, departs
from tests.support.until import until

pytestmark = pytest.mark.stack

DRIVE_S = 60.0
TOUR = """
[[waypoint]]
x_m = 0.8
y_m = 2.0
hold_s = 0.3

[[waypoint]]
x_m = 1.0
y_m = 2.0

[fence.circle]
x_m = 1
y_m = 2
radius_m = 2
"""


@pytest.fixture(scope="module")
def scene() -> Iterator[tuple[Crew, Witness]]:
    """Start a robot in standby in a world, and an observer; each test leaves it at rest."""
    with Crew(lockstep=True) as crew:
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


def test_a_mission_is_driven_from_a_file_and_comes_back_as_one(
    scene: tuple[Crew, Witness], tmp_path: Path
) -> None:
    path, back = tmp_path / "tour.toml", tmp_path / "back.toml"
    path.write_text(TOUR)
    crew, witness = scene
    mission = witness.bus.mailbox(MISSION, "r1")

    def over() -> bool:
        newest = mission.latest()
        status = newest[0] if newest else None
        return isinstance(status, MissionStatus) and status.state == MissionState.DONE

    done(crew, "mission", "upload", str(path))
    done(crew, "arm")
    done(crew, "mission", "start")
    until(over, DRIVE_S, "the mission is done")
    assert done(crew, "mission", "status") == "done, item 2 of 2\n"
    assert "outside of the fence" in done(crew, "goto", "5", "2", code=1)
    done(crew, "mission", "download", str(back))
    assert read(back) == read(path)
    done(crew, "fence", "off")


def test_second_operator_sees_the_first_and_may_stop_the_robot(
    scene: tuple[Crew, Witness], monkeypatch: pytest.MonkeyPatch
) -> None:
    crew, witness = scene
    goto = departs(crew, witness, "goto", "5.4", "2")
    monkeypatch.setenv("SIDESTEP_PERSON", "ben")
    assert "another operator commands the robot: " in done(crew, "goto", "1", "1", code=1)
    done(crew, "hold")
    monkeypatch.delenv("SIDESTEP_PERSON")
    until(witness.standing)
    assert "commands r1" in done(crew, "lease", "show")
    done(crew, "estop")
    until(witness.standing)
    assert goto.ends() == 1
    assert done(crew, "lease", "show") == "no operator holds the lease\n"
    done(crew, "clear-estop")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_teleop_robot_stops_when_its_operator_exits(
    scene: tuple[Crew, Witness], number: signal.Signals
) -> None:
    crew, witness = scene
    hand = crew.dialling("teleop", "0.3", "20")
    until(lambda: witness.truth.speed_m_s > 0.1)
    assert witness.status.mode == Mode.MANUAL
    hand.send(number)
    until(witness.standing, what="standing")
    assert hand.ends() == (130 if number is signal.SIGINT else -number)
