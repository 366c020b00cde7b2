"""The plant limits its log of rejected frames during a flood."""

from plant.process.run import RejectLog


def test_first_reject_is_logged_at_once_and_a_flood_briefly() -> None:
    counts: dict[str, int] = {}
    lines: list[str] = []
    log = RejectLog(lambda: counts, lines.append)
    log.look()
    assert lines == []
    for count in range(1, 1001):
        counts["drive/wheels"] = count
        log.look()
    assert lines[0].startswith("plant: 1 rejected on drive/wheels")
    assert 5 < len(lines) < 12


def test_each_path_is_logged_separately() -> None:
    lines: list[str] = []
    RejectLog(lambda: {"drive/wheels": 3, "sim/run": 1, "sim/world": 0}, lines.append).look()
    assert [line.split(": ")[1] for line in lines] == [
        "3 rejected on drive/wheels",
        "1 rejected on sim/run",
    ]
