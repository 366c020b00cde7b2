"""The judge finds nothing to object to: all rows pass, over UDP, with loss, and over TCP."""

import faulthandler
from pathlib import Path

import pytest

from tests.interop.vehicle import keep, two_robots, verdicts

pytestmark = pytest.mark.interop
WITHIN_S = 420.0
STARTED_S = 60.0
OWN = {
    15: "angle_offset -78.75; 8 values, step 22.5; frame 12",
    16: "orientations [0, 1, 2, 6, 7]",
    17: "WHEEL_DISTANCE count 2",
    22: "RC1_MIN after a set 1000.0",
    34: "5002: INVALID; 5004: INVALID",
}
"""What only this vehicle has: the rows accept others, too."""


@pytest.mark.parametrize(
    ("line", "kind", "options"),
    [("udp", "udp", ()), ("loss", "udp", ("--loss", "0.2")), ("tcp", "tcp", ())],
    ids=["udp", "loss", "tcp"],
)
def test_every_row_passes(
    line: str,
    kind: str,
    options: tuple[str, ...],
    seed: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # With loss and on a busy computer it takes longer than any other test.
    faulthandler.dump_traceback_later(WITHIN_S + STARTED_S, exit=True, file=2)
    with two_robots(tmp_path, kind, monkeypatch) as judged:
        words = ("--allow-motion", "--signing-key", str(judged.key), "--seed", str(seed))
        found = verdicts(judged, *words, *options, within_s=WITHIN_S)
        said = judged.gateway.said
        assert not any(judged.holds_key(path) for path in tmp_path.rglob("*.tlog"))
    keep(line, found)
    wrong = [f"{one['row']}: {one['evidence']}" for one in found["rows"] if one["status"] != "pass"]
    assert not wrong, "\n".join([*wrong, said[-500:]])
    evidence = {one["row"]: one["evidence"] for one in found["rows"]}
    assert sorted(evidence) == list(range(1, 73))
    for number, part in OWN.items():
        assert part in evidence[number]
    assert found["not_restored"] == []
