"""A comparison with the board continues where it was interrupted."""

from pathlib import Path

from checks.same_bits.on_board import BoardComparison, BoardDrive, Compared, all_drives, read, write


def result(drive: BoardDrive, image: str, time_s: float, on_board: str = "same") -> Compared:
    return Compared(*drive, "reached", time_s, "same", on_board, image, "core")


def test_drives_without_an_equal_result_of_the_image_are_run() -> None:
    drives = list(all_drives())
    rows = [
        result(drives[0], "new", 9.0),
        result(drives[1], "old", 9.0),
        result(drives[2], "old", 5.0),
        result(drives[3], "new", 50.0, on_board="another"),
    ]
    found = BoardComparison(1, rows)
    assert found.missing() == drives[4:]
    assert found.differing() == [rows[3]]
    assert found.todo("new") == [*drives[4:], drives[3], drives[2], drives[1]]


def test_new_result_replaces_that_of_the_same_drive(tmp_path: Path) -> None:
    drive, other = list(all_drives())[:2]
    found = BoardComparison(1, [result(drive, "old", 9.0), result(other, "old", 9.0)])
    found.put(result(drive, "new", 9.0))
    write(tmp_path / "digests.json", found)
    images = {one.drive: one.image for one in read(tmp_path / "digests.json").drives}
    assert images == {drive: "new", other: "old"}


def test_error_of_the_board_is_a_difference() -> None:
    drive = next(all_drives())
    assert not result(drive, "new", 9.0, on_board="the core on the board has failed").is_equal
