"""A slow disk delays acknowledgements only."""

import pytest

from checks.simulation.campaign import run
from checks.simulation.events import Argument, Event, EventScenario
from checks.simulation.hosts.operators import OperatorRequest, RequestHistory

S = 1_000_000_000


def event(at_s: float, kind: str, *arguments: Argument) -> Event:
    return Event(round(at_s * S), kind, arguments, 1)


@pytest.mark.parametrize("fsync_ms", [250, 2000])
def test_slow_disk_delays_no_tick_of_a_driving_robot(
    fsync_ms: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Parameter, fence and mission are saved under way; invariants are checked at every tick."""
    scenario = EventScenario(
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
    requests: list[OperatorRequest] = []
    begin = RequestHistory.begin

    def begun(history: RequestHistory, asked: OperatorRequest) -> None:
        requests.append(asked)
        begin(history, asked)

    monkeypatch.setattr(RequestHistory, "begin", begun)
    result = run(scenario)
    assert result.violation is None
    assert result.coverage.moving_ticks > 50
    saved = [one for one in requests if one.action in ("param", "fence", "mission")]
    assert [one.answered for one in saved] == [True] * 3, "operators are told that it is saved"
    assert not [state for state in result.coverage.reached if state.startswith("FAILSAFE")]
