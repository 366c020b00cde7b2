"""The core on the board gives the trajectory of CPython, and C the same elementary functions."""

import ctypes
import shutil
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from math import copysign, inf, nan, nextafter, pi
from pathlib import Path
from random import Random
from struct import pack
from typing import Final

import pytest

from checks.speed.board.measure import Build, build, counted, excesses, report_of, summary
from firmware import translator
from firmware.board import Board
from firmware.host import BoardCore
from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.navigators import NAVIGATORS, USUAL_NAVIGATOR
from protocol.wire.messages import BoardReport
from protocol.world import Start
from robot.core.values import Outputs
from runtime import elementary
from runtime.errors import LocalError
from study.cli.trial import elsewhere
from study.trial.core_loop import CoreLoop
from study.trial.trial import Trial, run_trial

SHORT_S: Final = 6.0
LONG_S: Final = 120.0
NEAR: Final = Start(x_m=1.8, y_m=2.0, heading_rad=0.0)
"""In the world `disc`, 0.8 m before the obstacle."""

Step = tuple[int, int, int, float, float, float]


class Steps:
    """Wheel commands and estimated poses, tick by tick; and what the board reports of itself."""

    def __init__(self) -> None:
        self.steps: list[Step] = []
        self.reports: list[BoardReport] = []

    def __call__(self, plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        """Note one tick."""
        left, right, guard = outputs.left_mrad_s, outputs.right_mrad_s, outputs.guard
        self.steps.append((left, right, guard, *onboard.state.odometry.pose))
        if isinstance(onboard.core, BoardCore):
            self.reports.append(report_of(onboard.core))


@pytest.fixture
def limit_s(request: pytest.FixtureRequest) -> float:
    """Return the simulated time after which a drive ends."""
    return LONG_S if request.config.getoption("--examples") == "long" else SHORT_S


@pytest.fixture(scope="module")
def made(firmware: Path) -> Build:
    """Return the sizes that a board with the image reports."""
    return build()


@pytest.mark.mcu
@pytest.mark.parametrize("navigator", NAVIGATORS)
def test_board_drives_as_cpython_within_its_ceilings(
    navigator: str, made: Build, firmware: Path, limit_s: float
) -> None:
    world = elsewhere(load("disc"), NEAR, None, 0.0)
    until_s = LONG_S if navigator == USUAL_NAVIGATOR else limit_s
    trial = Trial(world=world, navigator=navigator, seed=3, timeout_s=until_s, moved=True)
    with counted(firmware) as found:
        reports = assert_equal(trial, found.board)
    cost = summary(navigator, "disc", True, reports, found)
    assert cost.ticks > 100
    assert cost.whole_instructions > cost.command_instructions > 100_000
    assert excesses(made, cost) == []


@pytest.mark.mcu
def test_board_drives_as_cpython_without_noise(board: Board, limit_s: float) -> None:
    assert_equal(Trial(world=load("paper_fig7"), noise="none", timeout_s=limit_s), board)


@pytest.mark.mcu
def test_board_keeps_every_bit_of_parameters_and_start(board: Board, limit_s: float) -> None:
    """Drive; then without these parameters on the same board, which was restarted."""
    parameters = {"k_rho": 2.9 + 1e-15, "accel_m_s2": 1.0 / 0.7}
    trial = Trial(world=load("open"), parameters=parameters, timeout_s=limit_s)
    assert_equal(trial, board)
    board.restart()
    assert_equal(replace(trial, parameters={}), board)


def assert_equal(trial: Trial, board: Board) -> list[BoardReport]:
    """Run a trial in this process and on the board; compare every tick, return its reports."""
    ours, theirs = Steps(), Steps()
    expected = run_trial(trial, ours)
    found = run_trial(trial, theirs, partial(BoardCore, board))
    pairs = enumerate(zip(ours.steps, theirs.steps, strict=False))
    differing = next(((tick, *pair) for tick, pair in pairs if pair[0] != pair[1]), None)
    assert differing is None
    assert len(theirs.steps) == len(ours.steps)
    assert found.digest == expected.digest
    assert (found.outcome, found.time_s) == (expected.outcome, expected.time_s)
    assert found.estimated_position_error_m == expected.estimated_position_error_m
    return theirs.reports


SOURCE: Final = Path(elementary.__file__).read_text(encoding="utf-8")
COUNT: Final = {"usual": 25_000, "long": 400_000}
"""Of arguments by `--examples`; the special ones are fewer than 10,000 and always among them."""
HOST: Final = """\
#include <math.h>
#include <stdint.h>
typedef double real;
#define REAL_SQRT sqrt
#define REAL_COPYSIGN copysign
"""
OPTIONS: Final = ("-O2", "-ffp-contract=off", "-shared", "-fPIC")
SPECIAL: Final = (0.0, 5e-324, 2.0**-1022, 2.0**-500, 1e-9, 0.5, 1.0, 1e16, 2.0**500, 1e308, inf)
BETWEEN_0_AND_1: Final = {"coarse_acos"}
"""Functions that are defined only there: Python raises an error for the root of a negative one."""
SQUARES_FINITE: Final = 1e150

Values = tuple[float, ...]


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """Compile the translation for this machine."""
    if shutil.which("gcc") is None:
        pytest.skip("packages are not installed: gcc")
    folder = tmp_path_factory.mktemp("elementary")
    text = HOST + translator.translated(SOURCE, elementary)
    (folder / "functions.c").write_text(text.replace("\nstatic ", "\n"), encoding="utf-8")
    command = ["gcc", *OPTIONS, "-o", "functions.so", "functions.c", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "functions.so"))


def compiled(library: ctypes.CDLL, name: str, results: int, count: int) -> Callable[..., Values]:
    """Return a function of the library, whose results are a tuple."""
    fields = [(f"part_{i}", ctypes.c_double) for i in range(results)]
    shape = type("Shape", (ctypes.Structure,), {"_fields_": fields})
    function = getattr(library, f"translated_{name}")
    function.argtypes = [ctypes.c_double] * count
    function.restype = shape if results > 1 else ctypes.c_double

    def call(*given: float) -> Values:
        found = function(*given)
        return tuple(getattr(found, field) for field, _ in fields) if results > 1 else (found,)

    return call


def arguments(name: str, count: int) -> Iterator[Values]:
    """Yield special values with their neighbours, then random ones of all sizes without end."""
    every = [sign * value for value in SPECIAL for sign in (1.0, -1.0)]
    every += [nextafter(value, side) for value in every for side in (-inf, inf)] + [nan]
    every += [pi / 4 * quarters for quarters in range(-9, 10)] + [0.0625, 0.55, 22.0, 709.9, -745.5]
    random = Random(name)
    if count == 1:
        yield from ((value,) for value in every)
    else:
        yield from ((one, two) for one in every for two in every)
    while True:
        yield tuple(any_number(name, random) for _ in range(count))


def any_number(name: str, random: Random) -> float:
    """Return a number from a range that is picked first."""
    kind = 4 if name in BETWEEN_0_AND_1 else random.randrange(4)
    if kind == 0:
        return random.uniform(-1.0, 1.0)
    if kind == 1:
        return random.uniform(-1000.0, 1000.0)
    if kind == 2:
        return random.uniform(-8.0, 8.0)
    if kind == 4:
        return random.random()
    return copysign(2.0 ** random.uniform(-1070.0, 1020.0), random.random() - 0.5)


def is_in_domain(name: str, given: Values) -> bool:
    """Return whether Python's function raises no error for these arguments."""
    if name in BETWEEN_0_AND_1:
        return 0.0 <= given[0] <= 1.0
    return name != "hypot" or all(abs(value) < SQUARES_FINITE for value in given)


def bits(values: Values) -> bytes:
    """Return the bits; all NaN count as equal."""
    return b"".join(pack("<d", nan if value != value else value) for value in values)


@pytest.mark.parametrize(
    "name", [one.name for one in translator.functions_of(SOURCE) if not one.name.startswith("_")]
)
def test_translation_has_the_bits_of_python(
    name: str, library: ctypes.CDLL, pytestconfig: pytest.Config
) -> None:
    wanted = COUNT["long" if pytestconfig.getoption("--examples") == "long" else "usual"]
    definition = next(one for one in translator.functions_of(SOURCE) if one.name == name)
    count = len(definition.args.args)
    results = len(translator.result_types(definition))
    theirs = compiled(library, name, results, count)
    ours = getattr(elementary, name)
    compared = 0
    for given in arguments(name, count):
        if is_in_domain(name, given):
            if compared == wanted:
                break
            expected = ours(*given)
            values = expected if isinstance(expected, tuple) else (expected,)
            assert bits(theirs(*given)) == bits(values), given
            compared += 1
    assert compared == wanted


@pytest.mark.parametrize(
    "body",
    ["return x % 2.0", "return [x][0]", "return len(x)", "y = 1\n    y = 1.0\n    return y"],
)
def test_unknown_construct_is_refused_by_its_line(body: str) -> None:
    source = f"def strange(x: float) -> float:\n    {body}\n"
    with pytest.raises(LocalError, match=r"line \d+: no translation to C"):
        translator.translated(source, elementary)
