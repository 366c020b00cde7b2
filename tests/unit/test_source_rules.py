"""Rules for sources: the same bits on every machine, large imports, no markers of merges."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Final

from tests.support.each import each

ROOT = Path(__file__).resolve().parents[2]
CLOSED_LOOP = (
    *("robot", "plant", "protocol/outcome.py", "protocol/wire", "study/trial", "study/oracle"),
    "runtime",
)

MATH = {
    *("inf", "nan", "pi", "ceil", "copysign", "factorial", "floor", "isfinite", "isnan"),
    *("nextafter", "remainder", "sqrt"),
    *("degrees", "radians"),  # one product each
}
"""Exact, or rounded as IEEE 754 says."""

NUMPY = {
    # values and types
    *("bool_", "bytes_", "dtype", "float64", "inf", "int8", "int16", "int64"),
    *("uint8", "uint64"),
    # places in arrays
    *("append", "arange", "argsort", "argwhere", "array", "concatenate", "empty", "flatnonzero"),
    *("frombuffer", "full", "full_like", "isin", "nonzero", "ones", "ones_like", "pad"),
    *("count_nonzero", "meshgrid", "mgrid", "repeat"),
    *("searchsorted", "stack", "unique", "vstack", "where", "zeros", "ascontiguousarray"),
    # element by element, exact or rounded as IEEE 754 says
    *("abs", "add", "all", "clip", "copysign", "diff", "divide", "frexp", "maximum", "minimum"),
    *("divmod", "floor", "multiply", "outer", "sqrt", "subtract"),
    # the specified bits of a generator
    *("random.PCG64", "random.SeedSequence"),
    # a maximum has no rounding
    "maximum.reduce",
}

ALLOWED = {
    "plant/model/draws.py": {"import random"},  # only what Python promises; see the next test
    # sums of whole numbers
    "plant/cli.py": {"sum()"},
    "plant/imports/barn.py": {"sum()"},
    "plant/imports/cells.py": {"sum()"},
    "plant/imports/ros_bag.py": {"np.add.at"},
    "plant/sim/active_faults.py": {"sum()"},
    "plant/world/writer.py": {"sum()"},
    "robot/core/brain.py": {"sum()"},
    "robot/process.py": {"sum()"},
    "study/oracle/oracle_grid.py": {".cumsum()", "np.cumsum", ".sum()"},
    "study/oracle/grid_map.py": {"np.add.at", ".sum()"},
}
REDUCTIONS = {"cumprod", "cumsum", "dot", "mean", "prod", "std", "sum", "trace", "var"}
BUILTINS = {"pow", "sum"}
MODULES = {"cmath", "math", "random", "statistics"}


def files() -> list[Path]:
    return sorted(
        file
        for name in CLOSED_LOOP
        for file in ([ROOT / name] if name.endswith(".py") else (ROOT / name).rglob("*.py"))
    )


def imports(node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.Import):
        for alias in node.names:
            if alias.name.split(".")[0] in MODULES or alias.name.startswith("numpy."):
                yield f"import {alias.name}" if alias.name != "numpy.typing" else ""
            elif alias.name == "numpy" and alias.asname != "np":
                yield "import numpy by another name than np"
    elif isinstance(node, ast.ImportFrom) and node.module:
        top = node.module.split(".")[0]
        for alias in node.names:
            known = node.module == "math" and alias.name in MATH
            typing = node.module == "numpy.typing"
            if (top in MODULES or top == "numpy") and not known and not typing:
                yield f"from {node.module} import {alias.name}"


def dotted(node: ast.AST) -> str:
    if isinstance(node, ast.Attribute):
        return f"{dotted(node.value)}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else ""


def operations(node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.BinOp | ast.AugAssign):
        if isinstance(node.op, ast.MatMult):
            yield "@"
        if isinstance(node.op, ast.Pow) and not is_whole_power(node):
            yield "**"
    if isinstance(node, ast.Call):
        if isinstance(node.func, ast.Name) and node.func.id in BUILTINS:
            yield f"{node.func.id}()"
        if isinstance(node.func, ast.Attribute) and node.func.attr in REDUCTIONS:
            yield f".{node.func.attr}()"


def is_whole_power(node: ast.BinOp | ast.AugAssign) -> bool:
    sides = (node.left, node.right) if isinstance(node, ast.BinOp) else ()
    return bool(sides) and all(
        isinstance(side, ast.Constant) and isinstance(side.value, int) for side in sides
    )


def numpy_names(tree: ast.AST) -> set[str]:
    """Return the dotted names after `np.`, without those of which they are the beginning."""
    names = {
        dotted(node).removeprefix("np.")
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and dotted(node).startswith("np.")
    }
    return {name for name in names if not any(other.startswith(f"{name}.") for other in names)}


def complaints(text: str) -> set[str]:
    """Return everything in a source that may give other bits on another machine."""
    tree = ast.parse(text)
    found = {one for node in ast.walk(tree) for one in (*imports(node), *operations(node))}
    return (found | {f"np.{name}" for name in numpy_names(tree) - NUMPY}) - {""}


def test_the_closed_loop_uses_only_reproducible_operations() -> None:
    found = {file.relative_to(ROOT).as_posix(): complaints(file.read_text()) for file in files()}
    assert {name: those for name, those in found.items() if those} == ALLOWED


def test_only_the_promised_numbers_of_random_are_used() -> None:
    tree = ast.parse((ROOT / "plant/model/draws.py").read_text())
    used = {dotted(node) for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    assert {name for name in used if name.startswith(("random.", "self._source."))} == {
        "random.Random",
        "self._source.random",
        "self._source.getrandbits",
    }


def test_files_of_the_closed_loop_are_found() -> None:
    names = {file.relative_to(ROOT).as_posix() for file in files()}
    assert {"robot/core/brain.py", "plant/sim/drive.py", "study/trial/trial.py"} <= names
    assert {"plant/corpus/shapes.py", "protocol/outcome.py", "runtime/elementary.py"} <= names


@each(
    ("text", "complaint"),
    [
        ("from math import cos, pi", "from math import cos"),
        ("from math import hypot", "from math import hypot"),
        ("from math import fsum", "from math import fsum"),
        ("import math", "import math"),
        ("import math as m", "import math"),
        ("from cmath import exp", "from cmath import exp"),
        ("from random import Random", "from random import Random"),
        ("import statistics", "import statistics"),
        ("from numpy import sin", "from numpy import sin"),
        ("import numpy.linalg", "import numpy.linalg"),
        ("import numpy", "import numpy by another name than np"),
        ("y = np.sin(x)", "np.sin"),
        ("y = np.random.default_rng(1)", "np.random.default_rng"),
        ("y = np.add.reduce(x)", "np.add.reduce"),
        ("y = np.linalg.norm(x)", "np.linalg.norm"),
        ("y = x.sum(axis=1)", ".sum()"),
        ("y = x.dot(z)", ".dot()"),
        ("y = x @ z", "@"),
        ("y = x ** 2", "**"),
        ("y **= 2", "**"),
        ("y = pow(x, 2)", "pow()"),
        ("y = sum(x)", "sum()"),
    ],
)
def test_each_forbidden_operation_is_found(text: str, complaint: str) -> None:
    assert complaints(text) == {complaint}


def test_allowed_operations_are_not_reported() -> None:
    text = "from math import pi, sqrt\nimport numpy as np\ny = np.maximum.reduce(x) * 2**31"
    assert complaints(text) == set()


PACKAGES = (
    "protocol",
    "robot",
    "firmware",
    "plant",
    "ground",
    "gateways",
    "vehicle_check",
    "study",
)
MAY_IMPORT = {
    "zenoh": ("protocol/bus/", "gateways/ros2/node.py"),
    "pymunk": ("plant/sim/physics.py",),
    "pymavlink": (
        "gateways/mavlink/mavlink_dialect.py",
        "vehicle_check/mavlink_frames.py",
        "protocol/dialect/",
    ),
    "textual": ("ground/app", "ground/app/widgets"),
    "numpy": ("plant/", "study/", "ground/ros2/", "gateways/ros2/"),
    "rosbags": ("protocol/ros_bag.py", "ground/ros2/", "gateways/ros2/"),
}


@cache
def imports_of(file: Path) -> set[str]:
    """Return the top-level names of all imports of a file, nested ones included."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found.add(node.module.partition(".")[0])
    return found


def importers_of(library: str) -> list[str]:
    files = [file for package in PACKAGES for file in (ROOT / package).rglob("*.py")]
    return sorted(
        file.relative_to(ROOT).as_posix() for file in files if library in imports_of(file)
    )


def test_each_library_is_imported_only_where_it_belongs() -> None:
    strangers = {
        library: [file for file in importers_of(library) if not file.startswith(allowed)]
        for library, allowed in MAY_IMPORT.items()
    }
    assert strangers == {library: [] for library in MAY_IMPORT}


def test_import_rules_cover_files_with_imports() -> None:
    assert "plant/sim/physics.py" in importers_of("pymunk")
    assert any(file.startswith("protocol/bus/") for file in importers_of("zenoh"))


MARKER: Final = re.compile(rb"^(?:<{7}|>{7}) \S", re.MULTILINE)
SUFFIXES: Final = {".c", ".h", ".json", ".md", ".py", ".toml", ".xml", ".yml"}
FOLDERS: Final = (
    *("checks", "docs", "examples", "ground", "plant", "protocol"),
    *("robot", "runtime", "study", "tests"),
)


def marked(root: Path) -> Iterator[Path]:
    """Yield the text files below a folder that contain a marker."""
    for path in root.rglob("*"):
        if path.suffix in SUFFIXES and MARKER.search(path.read_bytes()):
            yield path


def test_no_file_has_an_unresolved_merge() -> None:
    top = [path for path in ROOT.glob("*.md") if MARKER.search(path.read_bytes())]
    assert [*top, *(path for name in FOLDERS for path in marked(ROOT / name))] == []


def test_an_unresolved_merge_is_found(tmp_path: Path) -> None:
    page, whole = tmp_path / "page.md", tmp_path / "whole.md"
    page.write_text(f"one\n{'<' * 7} HEAD\ntwo\n{'=' * 7}\nthree\n{'>' * 7} other\n")
    whole.write_text(f"{'<' * 8} a heading\n{'=' * 7}\n")
    assert list(marked(tmp_path)) == [page]
