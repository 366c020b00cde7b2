"""The elementary functions in C: the same bits as in Python."""

import ctypes
import shutil
import subprocess
from collections.abc import Callable, Iterator
from math import copysign, inf, nan, nextafter, pi
from pathlib import Path
from random import Random
from struct import pack
from typing import Final

import pytest

from firmware import translator
from runtime import elementary
from runtime.errors import LocalError

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
