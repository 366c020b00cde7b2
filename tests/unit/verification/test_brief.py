"""The choice of the tests of `make test`."""

from checks.brief import FileRecord, choose, modules

TOUCHING = {"a.py": {("a.py", 2), ("a.py", 3)}, "b.py": {("b.py", 2)}, "c.py": {("c.py", 2)}}


def record(cost_s: float, *lines: tuple[str, int]) -> FileRecord:
    return FileRecord(cost_s, frozenset(lines))


def test_every_module_is_touched_by_the_cheapest_files() -> None:
    records = {
        "cheap": record(1.0, ("a.py", 2)),
        "dear": record(3.0, ("a.py", 2), ("a.py", 3)),
        "both": record(3.5, ("b.py", 2), ("a.py", 1)),
    }
    assert choose(records, TOUCHING, 0.0) == (["both", "cheap"], ["c.py"])


def test_slow_file_is_chosen_only_for_a_module_that_needs_it() -> None:
    records = {
        "slow": record(9.0, ("a.py", 2), ("b.py", 2)),
        "quick": record(1.0, ("a.py", 3)),
        "useless": record(9.0, ("a.py", 2), ("a.py", 3)),
    }
    chosen, untouched = choose(records, TOUCHING, 100.0)
    assert (chosen, untouched) == (["quick", "slow"], ["c.py"])


def test_rest_of_the_budget_buys_the_most_lines() -> None:
    records = {
        "first": record(1.0, ("a.py", 2), ("b.py", 2), ("c.py", 2)),
        "many": record(2.0, *(("a.py", line) for line in range(10, 20))),
        "few": record(2.0, ("a.py", 30)),
        "same": record(2.0, ("a.py", 2)),
    }
    assert choose(records, TOUCHING, 4.0)[0] == ["first", "many"]
    assert choose(records, TOUCHING, 5.0)[0] == ["few", "first", "many"]


def test_modules_are_those_of_the_product() -> None:
    names = {path.as_posix() for path in modules()}
    assert "robot/core/brain.py" in names
    assert not any(name.startswith(("tests/", "checks/")) for name in names)
