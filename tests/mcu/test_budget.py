"""New measurements on the emulated board are within the ceilings; about half a minute."""

import pytest

from benchmarks.board.measure import build, measure_drive
from benchmarks.board.results import excesses
from study.trial.trial import NAVIGATORS, USUAL_NAVIGATOR

pytestmark = pytest.mark.mcu

SHORT_S = 6.0


@pytest.mark.usefixtures("firmware")
@pytest.mark.parametrize("navigator", NAVIGATORS)
def test_ticks_and_memory_are_within_their_ceilings(navigator: str) -> None:
    """Drive into an obstacle; the usual navigator drives to the end."""
    limit_s = 60.0 if navigator == USUAL_NAVIGATOR else SHORT_S
    cost = measure_drive("disc", navigator, limit_s)
    assert cost is not None
    assert cost.equal
    assert cost.ticks > 100
    assert cost.whole_instructions > cost.command_instructions > 100_000
    assert excesses(build(), cost) == []
