"""Missing frames of a log follow from gaps in the sequence numbers of each key."""

from pathlib import Path

from checks.faults.wall_time import lost_from, missing
from ground.recording.log_reader import record_bytes
from protocol.wire.codec import Encoder
from protocol.wire.enums import Severity
from protocol.wire.messages import Statustext, WheelTicks
from tests.support.each import each

UTC_2026_US = 1_795_000_000_000_000


@each(
    ("numbers", "gap"),
    [
        ([], 0),
        ([7], 0),
        ([254, 255, 0, 1], 0),
        ([1, 2, 5], 2),
        ([250, 4], 9),
        ([1, 3, 2, 4], 0),
        ([1, 1, 2], 0),
        ([1, 4, 2], 1),
        ([*range(256), *range(10)], 0),
    ],
)
def test_gaps_are_counted_across_wrap_and_reordering(numbers: list[int], gap: int) -> None:
    assert missing(numbers) == gap


def test_samples_and_events_are_counted_except_restarted_keys(tmp_path: Path) -> None:
    plant, robot = Encoder(1, 25), Encoder(1, 1)
    ticks = [
        plant.encode(WheelTicks(time_ns=n, seq=n, left=0, right=0, bumper=0, expired=0))
        for n in range(10)
    ]
    texts = [robot.encode(Statustext(severity=Severity.INFO, text=f"{n}")) for n in range(4)]
    kept = [*ticks[:3], *ticks[6:], texts[0], texts[3]]
    path = tmp_path / "20261121T000000Z-r1.tlog"
    path.write_bytes(
        b"".join(record_bytes(UTC_2026_US + at, frame) for at, frame in enumerate(kept))
    )
    lost = lost_from(path)
    assert (lost.logged, lost.samples, lost.events) == (9, 3, 2)
    assert lost.last_ns == (UTC_2026_US + 8) * 1000
    assert lost_from(path, restarted=("sense/",)).samples == 0
