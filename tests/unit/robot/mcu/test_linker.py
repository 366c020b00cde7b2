"""The linked program does what the separate modules do."""

from firmware.build import sources, values
from firmware.linker import Binding, Program

DRIVE = """
from robot.core import brain, modes, states
from robot.core.parameters import DEFAULTS
from robot.core.values import goal_of
from robot.core.values import Inputs, Scan, Wheels

def drive(navigator):
    params = DEFAULTS._replace(navigator=navigator)
    state = brain.State(params)
    told = []
    for tick in range(1, 400):
        wheels = Wheels(50 * (tick - 1), 48 * (tick - 1), 0, 50 * tick)
        ranges = tuple([abs(900 - (7 * tick + 131 * sonar) % 1800) + 1 for sonar in range(8)])
        scan = Scan(ranges, (5,) * 8, 255, 255)
        _, outputs = brain.step(state, Inputs(50 * tick, wheels, scan, None), params)
        told.append((outputs.left_mrad_s, outputs.right_mrad_s, *state.odometry.pose))
        if tick == 1:
            modes.arm(state.machine)
            goal = goal_of(9000, 500, 0, 0, 50, 50000)
            modes.goto(state.machine, goal, states.AUTO, 50)
    return told
"""


def linked(programs: dict[str, str], constants: dict[Binding, object] | None = None) -> str:
    """Link programs, of which `main` is run."""
    return Program(programs, constants or {}).linked("main")


def run(text: str) -> dict[str, object]:
    """Run a linked program and return its names."""
    names: dict[str, object] = {}
    exec(text, names)
    return names


def test_linked_core_drives_as_the_core() -> None:
    texts = {
        **sources(),
        "main": DRIVE + "\nFOUND = [drive(number) for number in range(1, 7)]\nFOUND\n",
    }
    theirs = run(Program(texts, values(texts)).linked("main"))["FOUND"]
    ours: dict[str, object] = {}
    exec(texts["main"], ours)
    assert theirs == ours["FOUND"]
    assert len(str(theirs)) > 10_000


def test_equal_names_of_two_modules_stay_apart() -> None:
    programs = {
        "one": "def value():\n    return 1\n",
        "two": "def value():\n    return 2\n",
        "main": "import one\nfrom two import value\nRESULT = (one.value(), value())\nRESULT\n",
    }
    assert run(linked(programs))["RESULT"] == (1, 2)


def test_local_name_hides_that_of_a_module() -> None:
    programs = {
        "one": (
            "LIMIT: Final = 3\ndef reach(LIMIT):\n    return LIMIT\ndef most():\n    return LIMIT\n"
        ),
        "main": (
            "import one\n"
            "def f(reach):\n    return one.reach(reach) + one.most()\n"
            "RESULT = f(10)\nRESULT\n"
        ),
    }
    text = linked(programs, {Binding("one", "LIMIT"): 3})
    assert run(text)["RESULT"] == 13
    assert "return 3" in text


def test_constants_become_literals_if_they_are_exact() -> None:
    constants: dict[str, object] = {"A": 7, "B": 0.25, "C": -0.5, "D": (1, 2), "E": True}
    lines = [f"{name}: Final = {value!r}" for name, value in constants.items()]
    programs = {
        "one": "\n".join(lines),
        "main": "from one import A, B, C, D, E\nR = (A, B, C, D, E)\nR\n",
    }
    text = linked(programs, {Binding("one", name): value for name, value in constants.items()})
    assert "R = 7, 0.25, C, (1, 2), E\n" in text
    assert run(text)["R"] == tuple(constants.values())


def test_unused_definitions_are_left_out() -> None:
    programs = {
        "one": "def used():\n    return 1\ndef unused():\n    return 2\n",
        "two": "def never():\n    pass\n",
        "main": "import one, two\ndef f(x: two.never) -> None:\n    one.used()\nf(1)\n",
    }
    text = linked(programs)
    assert "used()" in text
    assert "unused" not in text
    assert "never" not in text


def test_assigned_tuple_has_no_parentheses() -> None:
    assert "a, b = 1, 2\n" in linked({"main": "a, b = 1, 2\nprint(a, b)\n"})
