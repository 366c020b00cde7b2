"""A disk that takes its time holds up acknowledgements, and nothing else."""

import pytest

from verification.simulation.events import Argument, Event, Scenario
from verification.simulation.hosts.operators import Asked, History
from verification.simulation.simulation import run

S = 1_000_000_000


def event(at_s: float, kind: str, *arguments: Argument) -> Event:
    return Event(round(at_s * S), kind, arguments, 1)


@pytest.mark.parametrize("fsync_ms", [250, 2000])
def test_slow_disk_delays_no_tick_of_a_driving_robot(
    fsync_ms: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Parameter, fence and mission are saved under way; invariants watch over every tick."""
    scenario = Scenario(
        1,
        24 * S,
        (
            event(0.3, "come", "operator-a", 1),
            event(1.0, "slow disk", fsync_ms, 24_000),
            event(2.0, "operate", "operator-a", "drive", 31.0, 30.0, "GUIDED"),
            event(3.0, "operate", "operator-a", "param", "d_obs_m", 0.2),
            event(8.0, "operate", "operator-a", "fence", 5.0),
            event(14.0, "operate", "operator-a", "mission", 0.0, 30.5, 30.5),
        ),
    )
    told: list[Asked] = []
    begin = History.begin

    def begun(history: History, asked: Asked) -> None:
        told.append(asked)
        begin(history, asked)

    monkeypatch.setattr(History, "begin", begun)
    result = run(scenario)
    assert result.violation is None
    assert result.coverage.moving_ticks > 50
    saved = [one for one in told if one.action in ("param", "fence", "mission")]
    assert [one.answered for one in saved] == [True] * 3, "operators are told that it is saved"
    assert not [state for state in result.coverage.reached if state.startswith("FAILSAFE")]
