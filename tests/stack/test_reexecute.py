"""Recorded over the whole stack and executed again: nothing differs, lockstep or wall time."""

import json
import sys
from pathlib import Path

import pytest

from protocol.wire.reasons import Reason, reason_text
from tests.support.stack.processes import Crew

pytestmark = pytest.mark.stack

ROOT = Path(__file__).parents[2]
DRIVE_S = 60.0
LATE = reason_text(Reason.BUDGET)


def driven(crew: Crew, folder: Path, *words: str) -> Path:
    """The .mcap of a run to its goal, or until a busy machine has stopped the robot."""
    up = crew.start("up", "--headless", "--record", str(folder), *words)
    assert up.ends(DRIVE_S) == 0 or LATE in up.said, up.said
    (log,) = folder.glob("*.mcap")
    return log


def executed(crew: Crew, log: Path, *words: str) -> tuple[int, dict[str, object]]:
    again = crew.start("replay", str(log), "--re-execute", "--json", *words)
    code = again.ends(DRIVE_S)
    told: dict[str, object] = json.loads(again.said.splitlines()[-1])
    return code, told


@pytest.mark.parametrize(
    ("words", "ticks"),
    [
        (("--world", "u_trap", "--speed", "5"), 900),
        (("--world", "moving"), 20),
    ],
    ids=["in lockstep", "in wall time, where others walk about"],
)
def test_a_real_run_executed_again_is_the_same_in_every_tick(
    tmp_path: Path, words: tuple[str, ...], ticks: int
) -> None:
    with Crew() as crew:
        log = driven(crew, tmp_path, *words)
        for path in (log, log.with_suffix(".tlog")):
            code, told = executed(crew, path)
            assert code == 0, told
            assert told["compared"] == told["ticks"]
            assert int(str(told["compared"])) > ticks
            assert told["first"] is None
        code, told = executed(crew, log, "--navigator", "bug")
        assert code == 0
        assert isinstance(told["first"], dict)


def test_another_build_is_found_out(tmp_path: Path) -> None:
    """The same core with a slower ramp, as a later version might have it."""
    with Crew() as crew:
        log = driven(crew, tmp_path, "--world", "open", "--speed", "10")
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
