"""The power cut of the fault matrix: it passes for this robot, and finds one that forgets."""

import pytest

from verification.faults_matrix import power_cuts
from verification.power_cut import Disk


@pytest.mark.parametrize("number", range(4))
def test_what_was_acknowledged_is_there(number: int) -> None:
    one = power_cuts.run("a cut", "lockstep", number)
    assert (one.reached, one.trouble) == (True, "")


class NamesForgotten(Disk):
    """As a robot that does not synchronise directories: a rename may not be there."""

    def fsync(self, handle: int) -> None:
        if not self.isdir_open(handle):
            super().fsync(handle)


def test_a_rename_that_was_not_synchronised_is_found() -> None:
    found = [power_cuts.run("a cut", "lockstep", number, NamesForgotten()) for number in range(8)]
    assert any("instead of Held" in one.trouble for one in found)
