"""The cache of what is built once: complete entries only, made again when damaged, pruned."""

import os
from collections.abc import Callable
from pathlib import Path
from threading import Thread
from time import time

import pytest

from checks import built as cache
from checks.built import ROOT, BuildError, built, environment, key_of

MakesCounted = tuple[list[Path], Callable[[Path], None]]


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Redirect the cache to a folder of this test; return that of the kind `thing`."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "sidestep" / "built" / "thing"


@pytest.fixture
def making() -> MakesCounted:
    """Return the places that were filled, and the function that fills one."""
    made: list[Path] = []

    def make(place: Path) -> None:
        made.append(place)
        (place / "folder").mkdir()
        (place / "folder" / "result").write_text("42")

    return made, make


def test_entry_is_made_once_for_a_key(making: MakesCounted) -> None:
    made, make = making
    first, again = built("thing", "a", make), built("thing", "a", make)
    assert first == again
    assert (first / "folder" / "result").read_text() == "42"
    assert len(made) == 1
    built("thing", "b", make)
    assert len(made) == 2


def test_workers_wait_for_the_one_that_makes(making: MakesCounted) -> None:
    made, make = making
    workers = [Thread(target=built, args=("thing", "a", make)) for _ in range(6)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert len(made) == 1


@pytest.mark.parametrize("damage", [Path.unlink, lambda path: path.write_text("4")])
def test_damaged_entry_is_made_again(
    making: MakesCounted, damage: Callable[[Path], object]
) -> None:
    made, make = making
    damage(built("thing", "a", make) / "folder" / "result")
    assert (built("thing", "a", make) / "folder" / "result").read_text() == "42"
    assert len(made) == 2


def test_failed_or_interrupted_build_leaves_no_entry(home: Path, making: MakesCounted) -> None:
    def fail(place: Path) -> None:
        (place / "half").touch()
        raise BuildError("no compiler")

    with pytest.raises(BuildError, match="no compiler"):
        built("thing", "a", fail)
    (home / "unfinished-1").mkdir()  # of a process that was killed
    built("thing", "a", making[1])
    assert sorted(path.name for path in home.iterdir()) == ["a", "lock"]


def test_oldest_entries_are_removed_but_none_in_use(home: Path, making: MakesCounted) -> None:
    _, make = making
    for age, key in enumerate("abcdef"):
        entry = built("thing", key, make)
        used = time() - cache.IN_USE_S * (10 - age)
        os.utime(entry / cache.LISTED, (used, used))
    built("thing", "b", make)  # used now
    built("thing", "g", make)
    assert sorted(path.name for path in home.iterdir() if path.is_dir()) == ["b", "e", "f", "g"]


def test_key_depends_on_contents_and_facts_only() -> None:
    files = [ROOT / "pyproject.toml", ROOT / "README.md"]
    assert key_of(files, "gcc 12") == key_of(reversed(files), "gcc 12")
    others = {key_of(files, "gcc 12"), key_of(files, "gcc 13"), key_of(files[:1], "gcc 12")}
    assert len(others) == 3


def test_failed_installation_of_a_client_says_why() -> None:
    with pytest.raises(BuildError, match=r"pip .*: .*none-of-this-name"):
        environment("none", ["./none-of-this-name"])


def test_read_only_cache_is_replaced_by_a_temporary_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert cache.cache() == tmp_path / f"sidestep-built-{os.getuid()}"
