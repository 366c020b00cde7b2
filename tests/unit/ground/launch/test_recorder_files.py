"""The files of a run are those that its own recorders have printed."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from ground.launch.recorder_files import RecorderFiles
from tests.support.ground.recording.recorders import PrintingChildren, printing_children

FOLDER = Path("a folder of r1 and .mcap")
FIRST, SECOND = (FOLDER / f"20261123T10000{second}Z-r1.tlog" for second in (1, 2))


@pytest.fixture
def children() -> Iterator[PrintingChildren]:
    with printing_children() as found:
        yield found


def test_files_of_all_recorders_are_known_after_a_restart(children: PrintingChildren) -> None:
    files = RecorderFiles()
    children.start("robot r1", [])
    children.print_name(SECOND)
    children.start("recorder r1", [])
    files.update(children, FOLDER)
    assert (files.all, files.newest("r1")) == ([], None), "it has printed nothing yet"
    children.print_name(FIRST, before="only 0.5 GB free\n")
    files.update(children, FOLDER)
    assert files.newest("r1") == FIRST
    children.stop()
    children.start("recorder r1", [])
    files.update(children, FOLDER)
    assert files.newest("r1") == FIRST, "until the new recorder has created its own"
    children.print_name(SECOND)
    files.update(children, FOLDER)
    assert (files.newest("r1"), files.all) == (SECOND, [FIRST, SECOND])


def test_each_robot_has_its_own_file(children: PrintingChildren) -> None:
    files = RecorderFiles()
    arm = FOLDER / "20261123T100001Z-left-arm.1.tlog"
    for log in (FIRST, arm):
        children.start("recorder", [])
        children.print_name(log)
    files.update(children, FOLDER)
    assert (files.newest("left-arm"), files.newest("r1"), files.newest("r2")) == (arm, FIRST, None)


def test_output_that_another_thread_has_closed_is_no_error(children: PrintingChildren) -> None:
    files = RecorderFiles()
    children.start("recorder r1", [])
    children.print_name(FIRST)
    children.snapshot()[0].output.close()
    files.update(children, FOLDER)
    assert files.all == []
