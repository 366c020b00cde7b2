"""The mutation tests: the mutants, their verdicts, and the list of equivalent ones."""

import subprocess
import sys
from pathlib import Path
from textwrap import dedent

import pytest

from checks.mutation import mutants, runner
from checks.mutation.__main__ import TARGETS
from checks.mutation.mutants import EquivalentMutants, Identity, mistakes, mutants_of, page
from checks.mutation.runner import MutantVerdict
from tests.support.each import each

ROOT = Path(__file__).parents[3]


def changes(folder: Path, source: str) -> list[tuple[str, str]]:
    """Return the old and the new code of each mutant of a module."""
    file = folder / "module.py"
    file.write_text(dedent(source), encoding="utf-8")
    return [(one.identity.was, one.identity.now) for one in mutants_of(file, folder)]


@each(
    ("was", "now"),
    [
        ("a < b", {"a <= b", "a >= b"}),
        ("a <= b", {"a < b", "a > b"}),
        ("a > b", {"a >= b", "a <= b"}),
        ("a >= b", {"a > b", "a < b"}),
        ("a == b", {"a != b"}),
        ("a is None", {"a is not None"}),
        ("a not in b", {"a in b"}),
        ("a and b", {"a or b"}),
        ("not a", {"a"}),
        ("-a", {"a"}),
        ("a + b", {"a - b"}),
        ("a / b", {"a * b"}),
        ("a & b", {"a | b"}),
        ("True", {"False"}),
        ("7", {"8"}),
        ("0.0", {"1.0"}),
        ("2.0", {"3.0"}),
        ("1e-09", {"0.01"}),
        ("'words'", {"'XXwords'"}),
        ("states.HOLD", {"states.HOLD + 1"}),
        ("max(a, b)", {"min(a, b)"}),
        ("a if b else c", {"a if True else c", "a if False else c"}),
        ("[a for a in b if c]", {"[a for a in b if True]", "[a for a in b if False]"}),
        ("a.b", set()),
    ],
)
def test_expression_is_replaced_by_each_neighbour(tmp_path: Path, was: str, now: set[str]) -> None:
    wanted = [(f"x = {was}", f"x = {one}") for one in sorted(now)]
    assert sorted(changes(tmp_path, f"x = {was}")) == wanted


@each(
    ("statement", "now"),
    [
        ("a.b = c", ["pass"]),
        ("a.b += c", ["a.b -= c", "pass"]),
        ("a()", ["pass"]),
        ("raise a", ["pass"]),
        ("return a", ["return None"]),
        ("return False", ["return True"]),
        ("return", ["pass"]),
        ("if a:\n        b", ["if False:", "if True:"]),
        ("a: int", []),
    ],
)
def test_statement_is_deleted_or_its_condition_fixed(
    tmp_path: Path, statement: str, now: list[str]
) -> None:
    found = changes(tmp_path, f"def f(a, b, c):\n    {statement}\n")
    assert sorted(new for was, new in found if was != "b") == now


def test_text_without_effect_is_not_mutated(tmp_path: Path) -> None:
    source = '''
        """The docstring."""
        from other import LIMIT
        Row = NamedTuple("Row", [("a", "int")])

        class C:
            """Another."""
            __slots__ = ("a", "b")

            @wrapped(1)
            def f(self, a: "int | None") -> "int":
                """One more."""
    '''
    assert changes(tmp_path, source) == []


def test_mutant_is_identified_by_its_text(tmp_path: Path) -> None:
    function = "class C:\n    def f(self):\n        return self.a < 1\n"
    wanted = Identity("module.py", "C.f", "return self.a < 1", "return self.a <= 1")
    for source in (function, f"import os\n\n\n{function}"):
        (tmp_path / "module.py").write_text(source, encoding="utf-8")
        found = mutants_of(tmp_path / "module.py", tmp_path)
        assert [one.function for one in found if one.identity == wanted] == ["C.f"]


LAMP = """
LIMIT = 3

def lit(level):
    while True:
        level -= LIMIT
        break
    return level > 0
"""
TESTS = """
from lamp import lit

def test_lamp():
    assert lit(9) and not lit(1)
"""
CONFTEST = """
import gc

def pytest_collection_finish():
    gc.freeze()
"""
"""As tests/conftest.py: what is frozen is not found by the collector."""

TRY = """
import sys
from pathlib import Path
from checks.mutation import runner
from checks.mutation.mutants import mutants_of
from checks.mutation.runner import MutationTarget, verdicts
runner.EXTRA_CPU_S = 1
root = Path.cwd()
target = MutationTarget(root / "lamp.py", root, ("test_lamp.py",))
mutants = mutants_of(target.path, root)
for mutant, verdict in zip(mutants, verdicts(target, mutants, 2)):
    print(verdict.value, mutant.identity.now, sep=": ")
"""


def tried(folder: Path, lamp: str) -> "subprocess.CompletedProcess[str]":
    """Try the mutants of a lamp with its tests in a process of its own."""
    (folder / "lamp.py").write_text(lamp, encoding="utf-8")
    (folder / "test_lamp.py").write_text(TESTS, encoding="utf-8")
    (folder / "conftest.py").write_text(CONFTEST, encoding="utf-8")
    (folder / "pytest.ini").write_text("[pytest]\n", encoding="utf-8")
    environment = {"PYTHONPATH": f"{ROOT}:{folder}", "PATH": ""}
    return subprocess.run(
        [sys.executable, "-c", TRY], cwd=folder, env=environment, capture_output=True, text=True
    )


def test_failing_test_or_endless_loop_kills_mutant(tmp_path: Path) -> None:
    assert tried(tmp_path, LAMP).stdout.splitlines() == [
        "survived: LIMIT = 4",
        "killed: while False:",
        "killed: pass",
        "killed: level += LIMIT",
        "timeout: continue",
        "killed: return None",
        "survived: return level >= 0",
        "killed: return level <= 0",
        "survived: return level > 1",
    ]


def test_failing_tests_without_mutant_are_an_error(tmp_path: Path) -> None:
    ended = tried(tmp_path, LAMP.replace("3", "9"))
    assert ended.returncode != 0
    assert "lamp: its tests fail without a mutant: pytest test_lamp.py" in ended.stderr
    assert "AssertionError" in ended.stderr, "which test failed, and why"


def test_verdict_follows_from_the_exit_code() -> None:
    codes = (runner.PASSED, runner.FAILED, -9, -24)
    verdicts = (
        MutantVerdict.SURVIVED,
        MutantVerdict.KILLED,
        MutantVerdict.TIMEOUT,
        MutantVerdict.TIMEOUT,
    )
    assert tuple(runner.verdict_of(code) for code in codes) == verdicts
    with pytest.raises(KeyError):
        runner.verdict_of(1)


HALF = Identity("a.py", "f", "x < 1", "x <= 1")


def entry(why: str = "x is never 1") -> EquivalentMutants:
    return EquivalentMutants(HALF.module, HALF.scope, ((HALF.was, HALF.now),), why)


def test_surviving_equivalent_mutant_is_accepted() -> None:
    assert mistakes([entry()], ["a.py"], [HALF]) == []


@each(
    ("entries", "survivors", "mistake"),
    [
        ([entry()], [], "stale"),
        ([entry(), entry()], [HALF], "listed twice"),
        ([entry(why="")], [HALF], "without a reason"),
    ],
)
def test_list_of_equivalents_is_checked(
    entries: list[EquivalentMutants], survivors: list[Identity], mistake: str
) -> None:
    (found,) = mistakes(entries, ["a.py"], survivors)
    assert found.startswith(mistake)
    assert mistakes(entries, ["b.py"], survivors) == [], "only of the modules that were tried"


def test_every_listed_mutant_exists_in_the_source() -> None:
    listed = {identity for entry in mutants.load() for identity in entry.identities}
    assert {identity.module for identity in listed} <= TARGETS.keys()
    there = {one.identity for module in TARGETS for one in mutants_of(ROOT / module, ROOT)}
    assert listed - there == set(), "stale: the code has changed"


def test_targets_and_their_tests_exist() -> None:
    for module, tests in TARGETS.items():
        assert all((ROOT / file).is_file() for file in (module, *tests))


def test_page_lists_each_equivalent_mutant_with_its_reason() -> None:
    entry = EquivalentMutants(
        "a.py", "f", (("x < y", "x <= y"), ("x < y", "x > y")), "they never meet"
    )
    lines = page(["a.py", "b.py"], [entry]).splitlines()
    begin = lines.index("## `a.py`")
    assert lines[begin:] == [
        "## `a.py`",
        "",
        "In `f`: they never meet.",
        "",
        "```diff",
        "- x < y",
        "+ x <= y",
        "+ x > y",
        "```",
        "",
        "## Modules without such a mutant",
        "",
        "`b.py`.",
    ]


def test_page_of_equivalent_mutants_is_up_to_date() -> None:
    committed = (ROOT / "docs" / "evidence" / "mutants.md").read_text(encoding="utf-8")
    assert committed == page(TARGETS, mutants.load()), "make generate-docs"
