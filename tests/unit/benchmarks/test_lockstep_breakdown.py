"""The breakdown of a tick in stages."""

from checks.speed.lockstep import STAGES, ThreadCost, Usage, difference, points_ns, stages_us

TICK_NS = 100_000
POINTS = [point for _, point in STAGES[:-1]]


def notes_of(ticks: int) -> dict[str, list[tuple[str, int]]]:
    """Return notes that are 10 us apart."""
    notes: list[tuple[str, int]] = []
    for tick in range(ticks):
        begin_ns = tick * TICK_NS
        notes.append(("publish", begin_ns))
        notes += [(point, begin_ns + 10_000 * place) for place, point in enumerate(POINTS, 1)]
    return {"plant": notes, "robot": []}


def test_stages_add_up_to_the_tick() -> None:
    stages = stages_us(notes_of(9))
    assert stages == [10.0] * len(POINTS) + [20.0]
    assert sum(stages) * 1e3 == TICK_NS


def test_ticks_without_one_of_the_points_are_left_out() -> None:
    notes = notes_of(9)
    whole = stages_us(notes)
    notes["plant"] = [note for index, note in enumerate(notes["plant"]) if index != 3]
    assert stages_us(notes) == whole
    passed = [(point, time_ns) for time_ns, point in enumerate(POINTS)]
    assert points_ns(passed, 100) is not None
    assert points_ns(passed[1:], 100) is None
    assert points_ns([*passed, passed[-1]], 100) is None


def test_stage_ends_at_the_latest_when_the_next_one_does() -> None:
    passed = [(point, 10 * time_ns) for time_ns, point in enumerate(POINTS)]
    passed[0] = (passed[0][0], 15)
    ends = points_ns(passed, 200)
    assert ends is not None
    assert ends[:3] == [10, 10, 20]


def test_usage_is_the_difference_of_two_readings() -> None:
    before, after = (
        Usage(ThreadCost(5, 1), ThreadCost(7, 2)),
        Usage(ThreadCost(50, 11), ThreadCost(17, 3)),
    )
    assert difference(after, before) == Usage(ThreadCost(45, 10), ThreadCost(10, 1))
