"""The oldest recordings are deleted beyond a limit, but never while they are written."""

import os
import shutil
from datetime import UTC, datetime
from pathlib import Path

import pytest

from ground.launch.recording_session import DEFAULT_KEEP, byte_limit
from ground.recording.catalogue import LOW_BYTES, Retention, size_in, size_text
from ground.recording.log_writer import new_log
from ground.user.folders import recordings_folder
from runtime.errors import UserError
from tests.support.each import each
from tests.support.ground.recording.recorders import written

KB = 1000


def recorded(folder: Path, hour: int, size: int, robot: str = "r1") -> Path:
    """Create a recording of that hour: two files, a quarter of the size in the `.tlog`."""
    log = new_log(folder, robot, datetime(2026, 3, 4, hour, tzinfo=UTC))
    log.close()
    log.path.write_bytes(b"t" * (size // 4))
    log.path.with_suffix(".mcap").write_bytes(b"m" * (size - size // 4))
    return log.path


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@each(("text", "size"), [("2GB", 2 * 10**9), ("500 mb", 5 * 10**8), (" 1.5GB ", 15 * 10**8)])
def test_size_is_parsed_with_its_unit(text: str, size: int) -> None:
    assert size_in(text) == size


@each("text", ["", "2", "GB", "-1GB", "0MB", "2TB", "1e3MB", "٣GB!", "nanGB"])
def test_malformed_size_is_rejected(text: str) -> None:
    with pytest.raises(UserError, match="write it as 2GB or 500MB"):
        size_in(text)


def test_size_text_has_a_unit() -> None:
    assert [size_text(size) for size in (0, 1_234_567, 2 * 10**9)] == ["0 MB", "1.23 MB", "2 GB"]


def test_oldest_recordings_are_deleted_and_reported(tmp_path: Path) -> None:
    for hour in range(5):
        recorded(tmp_path, hour, 40 * KB)
    report = Retention(tmp_path, 100 * KB).delete_oldest()
    what = f"deleted the 3 oldest recordings in {tmp_path}, 0.12 MB"
    assert report == f"{what}, to keep within 0.1 MB (--keep)"
    assert [name[9:11] for name in names_in(tmp_path)] == ["03", "03", "04", "04"]
    assert Retention(tmp_path, 100 * KB).delete_oldest() == ""


def test_no_limit_deletes_nothing(tmp_path: Path) -> None:
    recorded(tmp_path, 0, 40 * KB)
    assert Retention(tmp_path, None).delete_oldest() == ""
    assert len(names_in(tmp_path)) == 2


def test_foreign_files_are_kept(tmp_path: Path) -> None:
    foreign = ["flight.tlog", "20260304T000000Z-r1.txt", "notes.mcap", "20260304-r1.tlog"]
    for name in foreign:
        (tmp_path / name).write_bytes(b"x" * 50 * KB)
    recorded(tmp_path, 0, 40 * KB)
    Retention(tmp_path, 1).delete_oldest()
    assert names_in(tmp_path) == sorted(foreign)


def test_file_being_written_is_not_deleted(tmp_path: Path) -> None:
    oldest = recorded(tmp_path, 0, 40 * KB)
    recorded(tmp_path, 1, 40 * KB, "r2")
    newest = new_log(tmp_path, "r1", datetime(2026, 3, 4, 2, tzinfo=UTC))
    newest.append(b"x" * 40 * KB)
    with written(oldest):
        assert "deleted the oldest recording in" in Retention(tmp_path, 50 * KB).delete_oldest()
    assert names_in(tmp_path) == sorted(
        [oldest.name, oldest.with_suffix(".mcap").name, newest.path.name]
    )
    Retention(tmp_path, 50 * KB).delete_oldest()
    assert names_in(tmp_path) == [newest.path.name]
    newest.close()


def test_single_recording_over_the_limit_is_kept(
    tmp_path: Path,
) -> None:
    log = new_log(tmp_path, "r1", datetime(2026, 3, 4, tzinfo=UTC))
    log.append(b"x" * 40 * KB)
    retention = Retention(tmp_path, 10 * KB)
    assert "alone exceeds 0.01 MB (--keep); it is kept" in retention.delete_oldest()
    assert retention.delete_oldest() == ""
    assert names_in(tmp_path) == [log.path.name]
    log.close()


def test_failed_deletion_keeps_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorded(tmp_path, 0, 40 * KB)

    def refused(_path: Path, **_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "unlink", refused)
    assert "deleted" not in Retention(tmp_path, 10 * KB).delete_oldest()
    assert len(names_in(tmp_path)) == 2


def test_warning_estimates_the_remaining_hours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    total = shutil.disk_usage(tmp_path)
    for free, expected in ((LOW_BYTES, ""), (400 * 10**6, "only 400 MB free in"), (0, "only 0 MB")):
        usage = total._replace(free=free)
        monkeypatch.setattr(shutil, "disk_usage", lambda _, usage=usage: usage)
        warning = Retention(tmp_path, None).warning()
        assert warning.startswith(expected)
        assert bool(warning) == bool(expected)
    assert "enough for about 0.0 h of one robot" in warning


def test_only_the_default_folder_has_a_limit(tmp_path: Path) -> None:
    assert byte_limit(tmp_path, None) is None
    assert byte_limit(tmp_path, "3GB") == 3 * 10**9
    recordings_folder().mkdir(parents=True, exist_ok=True)
    assert byte_limit(recordings_folder(), None) == size_in(DEFAULT_KEEP)
    other = tmp_path / "link"
    os.symlink(recordings_folder(), other)
    assert byte_limit(other, None) == size_in(DEFAULT_KEEP)
