"""Older recordings give way to newer ones, when that was asked for, and never while they grow."""

import fcntl
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

import pytest

from ground.launch.recording_session import DEFAULT_KEEP, byte_limit, default_folder
from ground.recording.log_writer import new_log
from ground.recording.retention import LOW_BYTES, Retention, in_units, size_in
from runtime.errors import UserError

KB = 1000


def recorded(folder: Path, hour: int, size: int, robot: str = "r1") -> Path:
    """A recording of that hour: both files, a quarter of it in the `.tlog`."""
    log = new_log(folder, robot, datetime(2026, 3, 4, hour, tzinfo=UTC))
    log.close()
    log.path.write_bytes(b"t" * (size // 4))
    log.path.with_suffix(".mcap").write_bytes(b"m" * (size - size // 4))
    return log.path


def there(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@contextmanager
def written(path: Path) -> Iterator[None]:
    """Somebody else has it open and writes."""
    with path.open("rb") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        yield


@pytest.mark.parametrize(
    ("text", "size"), [("2GB", 2 * 10**9), ("500 mb", 5 * 10**8), (" 1.5GB ", 15 * 10**8)]
)
def test_a_size_is_read_in_units(text: str, size: int) -> None:
    assert size_in(text) == size


@pytest.mark.parametrize("text", ["", "2", "GB", "-1GB", "0MB", "2TB", "1e3MB", "٣GB!", "nanGB"])
def test_what_is_no_size_is_refused_with_the_way_to_write_it(text: str) -> None:
    with pytest.raises(UserError, match="write it as 2GB or 500MB"):
        size_in(text)


def test_sizes_are_told_in_units() -> None:
    assert [in_units(size) for size in (0, 1_234_567, 2 * 10**9)] == ["0 MB", "1.23 MB", "2 GB"]


def test_the_oldest_go_until_the_rest_fits_and_it_is_told_in_one_line(tmp_path: Path) -> None:
    for hour in range(5):
        recorded(tmp_path, hour, 40 * KB)
    said = Retention(tmp_path, 100 * KB).tidy()
    what = f"deleted the 3 oldest recordings in {tmp_path}, 0.12 MB"
    assert said == f"{what}, to keep within 0.1 MB (--keep)"
    assert [name[9:11] for name in there(tmp_path)] == ["03", "03", "04", "04"]
    assert Retention(tmp_path, 100 * KB).tidy() == ""


def test_without_a_bound_nothing_is_ever_deleted(tmp_path: Path) -> None:
    recorded(tmp_path, 0, 40 * KB)
    assert Retention(tmp_path, None).tidy() == ""
    assert len(there(tmp_path)) == 2


def test_what_is_not_ours_stays_whatever_it_is_called(tmp_path: Path) -> None:
    strangers = ["flight.tlog", "20260304T000000Z-r1.txt", "notes.mcap", "20260304-r1.tlog"]
    for name in strangers:
        (tmp_path / name).write_bytes(b"x" * 50 * KB)
    recorded(tmp_path, 0, 40 * KB)
    Retention(tmp_path, 1).tidy()
    assert there(tmp_path) == sorted(strangers)


def test_what_is_being_written_is_never_deleted_by_whomever(tmp_path: Path) -> None:
    oldest = recorded(tmp_path, 0, 40 * KB)
    recorded(tmp_path, 1, 40 * KB, "r2")
    newest = new_log(tmp_path, "r1", datetime(2026, 3, 4, 2, tzinfo=UTC))
    newest.append(b"x" * 40 * KB)
    with written(oldest):
        assert "deleted the oldest recording in" in Retention(tmp_path, 50 * KB).tidy()
    assert there(tmp_path) == sorted(
        [oldest.name, oldest.with_suffix(".mcap").name, newest.path.name]
    )
    Retention(tmp_path, 50 * KB).tidy()
    assert there(tmp_path) == [newest.path.name]
    newest.close()


def test_one_recording_that_exceeds_the_bound_alone_is_kept_and_that_is_told_once(
    tmp_path: Path,
) -> None:
    log = new_log(tmp_path, "r1", datetime(2026, 3, 4, tzinfo=UTC))
    log.append(b"x" * 40 * KB)
    shelf = Retention(tmp_path, 10 * KB)
    assert "alone exceeds 0.01 MB (--keep); it is kept" in shelf.tidy()
    assert shelf.tidy() == ""
    assert there(tmp_path) == [log.path.name]
    log.close()


def test_a_folder_in_which_nothing_can_be_deleted_keeps_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorded(tmp_path, 0, 40 * KB)

    def refused(_path: Path, **_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "unlink", refused)
    assert "deleted" not in Retention(tmp_path, 10 * KB).tidy()
    assert len(there(tmp_path)) == 2


def test_little_room_is_told_with_how_long_it_lasts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    total = shutil.disk_usage(tmp_path)
    for free, says in ((LOW_BYTES, ""), (400 * 10**6, "only 400 MB free in"), (0, "only 0 MB")):
        usage = total._replace(free=free)
        monkeypatch.setattr(shutil, "disk_usage", lambda _, usage=usage: usage)
        warning = Retention(tmp_path, None).warning()
        assert warning.startswith(says)
        assert bool(warning) == bool(says)
    assert "enough for about 0.0 h of one robot" in warning


def test_only_the_usual_folder_is_bounded_unasked(tmp_path: Path) -> None:
    assert byte_limit(tmp_path, None) is None
    assert byte_limit(tmp_path, "3GB") == 3 * 10**9
    default_folder().mkdir(parents=True, exist_ok=True)
    assert byte_limit(default_folder(), None) == size_in(DEFAULT_KEEP)
    other = tmp_path / "link"
    os.symlink(default_folder(), other)
    assert byte_limit(other, None) == size_in(DEFAULT_KEEP)
