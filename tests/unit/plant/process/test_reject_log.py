"""Noise is told, and does not become noise itself."""

from plant.process.run import RejectLog as Unreadable


def test_the_first_is_told_at_once_and_a_flood_in_few_lines() -> None:
    counts: dict[str, int] = {}
    told: list[str] = []
    unreadable = Unreadable(lambda: counts, told.append)
    unreadable.look()
    assert told == []
    for count in range(1, 1001):
        counts["drive/wheels"] = count
        unreadable.look()
    assert told[0].startswith("plant: 1 rejected on drive/wheels")
    assert 5 < len(told) < 12


def test_each_path_is_told_by_itself() -> None:
    told: list[str] = []
    Unreadable(lambda: {"drive/wheels": 3, "sim/run": 1, "sim/world": 0}, told.append).look()
    assert [line.split()[1:7] for line in told] == [
        ["3", "unreadable", "or", "refused", "on", "drive/wheels:"],
        ["1", "unreadable", "or", "refused", "on", "sim/run:"],
    ]
