"""The power cut of the fault matrix passes this robot and fails one that loses renames."""

from checks.faults import power_cuts
from checks.faults.power_cuts import ReorderingDisk
from tests.support.each import each


@each("number", range(4))
def test_acknowledged_changes_survive(number: int) -> None:
    one = power_cuts.run("a cut", "lockstep", number)
    assert (one.reached, one.trouble) == (True, "")


class UnsyncedDirectories(ReorderingDisk):
    """A disk as of a robot that does not synchronise directories: a rename may be lost."""

    def fsync(self, handle: int) -> None:
        if not self.isdir_open(handle):
            super().fsync(handle)


def test_unsynchronised_rename_is_found() -> None:
    found = [
        power_cuts.run("a cut", "lockstep", number, UnsyncedDirectories()) for number in range(8)
    ]
    assert any("instead of SavedState" in one.trouble for one in found)
