"""A navigator of the user's own: found, checked, and each failure named with file and line."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from protocol.navigators import NAVIGATORS, is_own, name_of, own_source
from protocol.outcome import RunOutcome
from protocol.wire.enums import GoalState, Navigator
from protocol.wire.reasons import Reason, reason_text
from robot import own_navigator
from robot.core.navigators import registry
from robot.own_navigator import install, load
from runtime.errors import UserError
from sidestep.__main__ import main as sidestep
from study.trial.trial import Trial, run_trial
from tests.support.each import each
from tests.support.plant import plain_world
from tests.support.robots import armed

NEAR = plain_world("near", (3.0, 2.0), (0.6, 1.0), (1.4, 1.0, 0.0))
STEP = "from sidestep.navigators import *\ndef step(memory, pose, ring, goal, params):\n"
AHEAD = "    return towards(goal_bearing_rad(pose, goal), pose, ring, goal)\n"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Work in an empty folder, and forget what was registered."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield tmp_path
    registry.NAVIGATORS.pop(Navigator.OWN, None)


def written(text: str, name: str = "mine") -> str:
    Path(f"{name}.py").write_text(text)
    return f"{name}.py"


def driven(reference: str) -> RunOutcome:
    return run_trial(Trial(world=NEAR, navigator=reference, noise="none", timeout_s=20.0))


def test_template_arrives_and_has_the_name_of_its_file() -> None:
    assert sidestep(["navigators", "new", "my_nav"]) == 0
    run = driven("my_nav.py")
    assert (run.outcome, run.navigator) == ("reached", "my_nav")


def test_module_and_function_name_a_navigator() -> None:
    Path("pack").mkdir()
    Path("pack/nav.py").write_text(STEP.replace("step(", "turn(") + AHEAD)
    run = driven("pack.nav:turn")
    assert (run.outcome, run.navigator) == ("reached", "turn")


def test_changed_file_is_loaded_again() -> None:
    file = written(STEP + AHEAD)
    assert driven(file).outcome == "reached"
    written(STEP + "    return towards(0.0, pose, ring, goal, speed_limit_m_s=0.0)\n")
    assert driven(file).outcome == "stuck"


def test_two_versions_of_a_navigator_do_not_mix() -> None:
    one, two = written(STEP + AHEAD, "one"), written(STEP + "    return None\n", "two")
    assert [driven(name).outcome for name in (one, two, one)] == ["reached", "aborted", "reached"]


@each(
    ("text", "said"),
    [
        ("def step(memory,\n", "mine.py, line 1: SyntaxError"),
        ("x = 1\nx.y\n", "mine.py, line 2: AttributeError: 'int' object has no attribute 'y'"),
        ("import nunpy\n", "mine.py, line 1: ModuleNotFoundError"),
        ("import sys\nsys.exit(3)\n", "mine.py, line 2: SystemExit: 3"),
        ("\0\1\2", "mine.py: SyntaxError: source code string cannot contain null bytes"),
        ("def turn(): ...\n", "has no function 'step': write `def step(memory, pose, ring, goal, "),
        ("def turn(): ...\n", "or name one of turn"),
        ("\ndef step(pose): ...\n", "mine.py, line 2: step(pose) does not take (memory, pose,"),
        ("async def step(memory, pose, ring, goal, params): ...\n", "must be a plain `def`"),
        (STEP + AHEAD + "class Memory:\n    __slots__ = ()\n", "class Memory: AttributeError"),
        (STEP + AHEAD + "class Memory:\n    def __init__(self, n): ...\n", "without arguments"),
    ],
)
def test_file_that_cannot_be_loaded_is_named_with_its_line(text: str, said: str) -> None:
    with pytest.raises(UserError, match=r"mine\.py") as error:
        load(written(text))
    assert said in str(error.value)


@each(
    ("reference", "said"),
    [
        ("none.py", "there is no such file; `sidestep navigators new none` writes one"),
        ("no.such:step", "there is no such module from "),
        ("bug.py", "bug is the name of a navigator of the robot"),
        ("bug:up", "bug is a navigator of the robot: give its name alone"),
    ],
)
def test_reference_that_leads_nowhere_is_refused(reference: str, said: str) -> None:
    written("", "bug")
    with pytest.raises(UserError) as error:
        load(reference)
    assert said in str(error.value)


@each(
    ("body", "said"),
    [
        ("    return 1 / 0\n", "mine.py, line 3, step: ZeroDivisionError: division by zero"),
        ("    return goal.x\n", "line 3, step: AttributeError: 'Goal' object has no attribute 'x'"),
        ("    import sys\n    sys.exit(3)\n", "mine.py, line 4, step: SystemExit: 3"),
        ("    pass\n", "mine.py, line 2, step: returned nothing: return a Decision"),
        ("    return 5\n", "returned a value of type int"),
        (AHEAD.replace("goal)\n", "goal, float('nan'))\n"), "speed_limit_m_s = nan: must be a num"),
        (AHEAD.replace("goal)\n", "goal, -1)\n"), "speed_limit_m_s = -1: must be a number from 0"),
        (AHEAD.replace("goal)\n", "goal)._replace(branch=9)\n"), "branch 9: use TO_GOAL"),
        (AHEAD.replace("goal)\n", "goal)._replace(rotation_rad=None)\n"), "rotation_rad = None"),
        ("    memory.n += 1\n", "the memory has no 'n' yet: set it first"),
    ],
)
def test_step_that_fails_ends_the_goal_with_file_and_line(body: str, said: str) -> None:
    run = driven(written(STEP + body))
    assert run.outcome == "aborted"
    assert run.reason.startswith(f"{reason_text(Reason.NAVIGATOR_FAILED)}: ")
    assert said in run.reason
    assert run.path_m == 0.0


def test_failure_of_a_memory_is_that_of_the_first_step() -> None:
    memory = "class Memory:\n    made = 0\n    def __init__(self):\n        Memory.made += 1\n"
    memory += "        1 / (Memory.made < 2)\n"
    run = driven(written(STEP + AHEAD + memory))
    assert "mine.py, line 8, __init__: ZeroDivisionError" in run.reason


def test_step_that_does_not_end_is_interrupted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(own_navigator, "STEP_LIMIT_NS", 50_000_000)
    body = "    while True:\n        try: pass\n        except Exception: pass\n"
    run = driven(written(STEP + body))
    assert "the step has not ended after 0.05 s of processor time" in run.reason
    assert driven(written(STEP + AHEAD)).outcome == "reached"


def test_file_that_does_not_end_is_interrupted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(own_navigator, "LOAD_LIMIT_NS", 50_000_000)
    with pytest.raises(UserError, match=r"mine\.py, line 2: has not been loaded after 0\.05 s"):
        load(written("x = 1\nwhile True: pass\n"))
    own_navigator.load(written(STEP + AHEAD))


def test_robot_stops_and_tells_the_fault_of_its_navigator() -> None:
    body = "    memory.n = getattr(memory, 'n', 0) + 1\n    if memory.n > 20:\n        1 / 0\n"
    install(load(written(STEP + body + AHEAD)))
    desk = armed()
    assert desk.vehicle.core.adopt(desk.vehicle.params._replace(navigator=Navigator.OWN)) == 0
    assert desk.goto(2.0, 0.0) == Reason.NONE
    for _ in range(22):
        desk.step()
    machine = desk.vehicle.state.machine
    assert (machine.goal_state, machine.goal_reason) == (
        GoalState.ABORTED,
        Reason.NAVIGATOR_FAILED,
    )
    said = "".join(text.text for text in desk.vehicle.texts())
    assert "mine.py, line 5, step: ZeroDivisionError" in said
    assert [desk.step().left_mrad_s for _ in range(40)][-1] == 0


def test_slow_navigator_is_named_when_the_robot_stops_for_time() -> None:
    assert own_navigator.cost_words() == ""
    install(load(written(STEP + AHEAD)))
    assert own_navigator.cost_words().startswith("a step of mine takes 0.0 ms")


@each(
    ("text", "is_reference", "name"),
    [
        ("bug", False, "bug"),
        ("my_nav.py", True, "my_nav"),
        ("/a/b.c/my_nav.py:turn", True, "turn"),
        ("package.module", True, "module"),
        ("module:step", True, "module"),
        (":left", False, "left"),
    ],
)
def test_names_and_references_are_told_apart(text: str, is_reference: bool, name: str) -> None:
    assert is_own(text) is is_reference
    assert name_of(text) == name


def test_path_of_a_file_holds_in_any_folder(folder: Path) -> None:
    written(STEP + AHEAD)
    assert str(own_source("mine.py:turn")) == f"{folder}/mine.py:turn"


def test_no_traceback_of_a_users_file_reaches_the_terminal() -> None:
    words = ("trial", "--world", "open", "--navigator", written(STEP + "    1 / 0\n"))
    done = subprocess.run(
        [sys.executable, "-m", "sidestep", *words], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (1, "")
    assert "mine.py, line 3, step: ZeroDivisionError" in done.stdout.splitlines()[0]


@each("action", ["list", "list --json"])
def test_list_has_each_navigator_of_the_robot(
    action: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sidestep(["navigators", *action.split()]) == 0
    printed = capsys.readouterr().out
    assert all(name in printed for name in NAVIGATORS)


@each("name", ["bug", "a-b", "1st", "new"])
def test_new_refuses_a_name_that_is_none_or_taken(name: str) -> None:
    Path("new.py").touch()
    assert sidestep(["navigators", "new", name]) == 2
    assert [file.name for file in Path().glob("*.py")] == ["new.py"]
