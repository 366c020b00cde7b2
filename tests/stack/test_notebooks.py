"""The notebooks of examples/, executed cell by cell as Jupyter does, without Jupyter."""

import ast
import asyncio
import inspect
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import pytest

pytestmark = pytest.mark.stack

EXAMPLES: Final = Path(__file__).parents[2] / "examples"
SHOWS: Final = ("_repr_html_", "_repr_svg_", "_repr_png_")


def cells_of(path: Path) -> Iterator[str]:
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            assert not cell["outputs"], f"{path.name}: clear the outputs before a commit"
            yield "".join(cell["source"])


def executed(path: Path) -> list[Any]:
    """Return the value that each cell shows; a cell may await at its top level."""
    names: dict[str, Any] = {"__name__": "__main__"}
    shown: list[Any] = []
    with asyncio.Runner() as runner:

        def evaluate(tree: Any, mode: str) -> Any:
            code = compile(tree, path.name, mode, ast.PyCF_ALLOW_TOP_LEVEL_AWAIT)
            found = eval(code, names)
            return runner.run(found) if inspect.iscoroutine(found) else found

        for source in cells_of(path):
            tree = ast.parse(source)
            *before, last = tree.body
            value = None
            if isinstance(last, ast.Expr):
                tree.body = before
                evaluate(tree, "exec")
                value = evaluate(ast.Expression(last.value), "eval")
            else:
                evaluate(tree, "exec")
            methods = [getattr(value, method) for method in SHOWS if hasattr(value, method)]
            assert not methods or any(method() for method in methods), source
            shown.append(value)
    return shown


@pytest.mark.parametrize("name", ["trials", "recordings", "robot"])
def test_notebook_runs_from_its_first_to_its_last_cell(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shown = executed(EXAMPLES / f"{name}.ipynb")
    said = " ".join(map(repr, shown))
    assert {
        "trials": "outcome='reached'" in said,
        "recordings": "<Recording " in said,
        "robot": "GoalEnded(outcome='reached'" in said,
    }[name], said


def test_every_notebook_is_executed() -> None:
    assert {one.stem for one in EXAMPLES.glob("*.ipynb")} == {"trials", "recordings", "robot"}
