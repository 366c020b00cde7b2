"""Recorded over the whole stack and executed again: nothing differs, lockstep or wall time."""

import json
import sys
from pathlib import Path

import pytest

from protocol.wire.reasons import reason_text
from tests.support.stack.processes import LATE, Crew

pytestmark = pytest.mark.stack

ROOT = Path(__file__).parents[3]
DRIVE_S = 60.0


def driven(crew: Crew, folder: Path, *words: str) -> Path:
    """Return the .mcap of a drive to its goal, to its timeout, or until it is stopped as late."""
    up = crew.start("up", "--headless", "--record", str(folder), *words)
    ends = ("reached", "timeout in", *map(reason_text, LATE))
    assert up.ends(DRIVE_S) in (0, 1)
    assert any(end in up.said for end in ends), up.said
    (log,) = folder.glob("*.mcap")
    return log


def executed(crew: Crew, log: Path, *words: str) -> tuple[int, dict[str, object]]:
    again = crew.start("replay", str(log), "--re-execute", "--json", *words)
    code = again.ends(DRIVE_S)
    told: dict[str, object] = json.loads(again.said.splitlines()[-1])
    return code, told


def test_lockstep_drive_executed_again_is_the_same_in_every_tick(tmp_path: Path) -> None:
    with Crew() as crew:
        log = driven(crew, tmp_path, "--world", "u_trap", "--speed", "max", "--timeout", "31")
        is_the_same(crew, log, ticks=600)
        code, told = executed(crew, log, "--navigator", "bug")
        assert code == 0
        assert isinstance(told["first"], dict)


def test_wall_time_drive_executed_again_is_the_same_in_every_tick(tmp_path: Path) -> None:
    """Pedestrians walk there; a busy machine may stop the robot, and the ticks until then count."""
    with Crew() as crew:
        words = ("--clock", "wall", "--world", "moving", "--timeout", "4")
        is_the_same(crew, driven(crew, tmp_path, *words))


def is_the_same(crew: Crew, log: Path, *, ticks: int = 0) -> None:
    """Execute both logs of a drive again, and compare more than so many ticks."""
    for path in (log, log.with_suffix(".tlog")):
        code, told = executed(crew, path)
        assert code == 0, told
        assert told["compared"] == told["ticks"]
        assert int(str(told["compared"])) > ticks
        assert told["first"] is None


def test_another_build_is_found_out(tmp_path: Path) -> None:
    """Use the same core with a slower ramp, as another version might have."""
    with Crew() as crew:
        log = driven(crew, tmp_path, "--world", "open", "--speed", "max")
        other = (
            "import sys; from robot.core import brain; from robot.core.motion import controller;"
            " ramp = controller.ramp;"
            " brain.ramp = lambda wanted, last, params:"
            " ramp(wanted, last, params._replace(accel_m_s2=0.9 * params.accel_m_s2));"
            " from study.cli.reexecute import main; sys.exit(main(sys.argv[1:]))"
        )
        later = crew.execute(sys.executable, "-c", other, str(log), "--json")
        assert later.ends() == 1, later.said
        told = json.loads(later.said.splitlines()[-1])
        assert told["first"]["message"] == "WheelCommand"
        assert told["first"]["tick"] < 30
