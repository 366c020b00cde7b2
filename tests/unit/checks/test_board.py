"""The board: the worst tick, sizes of objects, committed figures, and the same bits."""

import sys
from pathlib import Path

import msgspec
import pytest

from checks.same_bits import on_board
from checks.same_bits.on_board import BoardComparison, BoardDrive, Compared, all_drives, write
from checks.same_bits.on_board import read as on_board_read
from checks.site import microcontroller_page
from checks.speed.board import float32
from checks.speed.board import measure as results
from checks.speed.board.measure import (
    CEILINGS,
    FLASH_BYTES,
    RAM_BYTES,
    Cost,
    excesses,
    read,
)
from checks.speed.board.scenarios import (
    MEASURED,
    TickScenario,
    bytecodes,
    heap_bytes,
    lengths,
    run_scenario,
    search,
)
from plant.world.file import shipped
from protocol.navigators import NAVIGATORS
from robot.core.values import Pose
from robot.hosting import InProcessCore
from study.report.targets import STATE_BYTES
from tests.support.each import each


def test_search_ranks_scenarios_by_their_worst_tick() -> None:
    worst = {number: bytecodes(TickScenario("vgm", number), 30) for number in range(4)}
    best = sorted(worst, key=lambda number: -worst[number])[:MEASURED]
    assert search("vgm", 4, 30) == [("vgm", number) for number in best]
    assert min(worst.values()) > 1000
    assert len(set(worst.values())) > 1


def test_longer_scenario_is_never_cheaper() -> None:
    scenario = TickScenario("bug", 1)
    assert bytecodes(scenario, 20) <= bytecodes(scenario, 60)


def test_search_restores_the_trace_function() -> None:
    before = sys.gettrace()
    bytecodes(TickScenario("bug", 0), 2)
    assert sys.gettrace() is before


def test_scenario_drives_and_is_the_same_again() -> None:
    runs = []
    for _ in range(2):
        scenario = TickScenario("vgm_memory", 1)
        core = InProcessCore(scenario.params())
        body = scenario.body()
        runs.append([core.state.odometry.pose for _ in run_scenario(core, body, 80)])
    assert runs[0] == runs[1]
    assert len(set(runs[0])) > 40


class Thing:
    __slots__ = ("a", "b")

    def __init__(self, a: object, b: object) -> None:
        self.a, self.b = a, b


class Loose:
    """An object with a __dict__, whose size is not bounded."""


def test_memory_size_is_that_of_its_blocks() -> None:
    assert heap_bytes(Thing(1, None)) == 32
    assert heap_bytes(Thing(1.5, 1 << 40)) == 32 + 16 + 32
    assert heap_bytes(Thing([0] * 10, bytearray(20))) == 32 + (16 + 48) + (16 + 32)
    assert heap_bytes(Thing([0.0] * 10, Pose(0.0, 0.0, 0.0))) == 32 + (16 + 48 + 160) + (32 + 48)
    shared = [0] * 4
    assert heap_bytes(Thing(shared, shared)) == 32 + 32
    with pytest.raises(TypeError, match="Loose: no __slots__"):
        heap_bytes(Thing(Loose(), 1))


def test_lengths_grow_with_a_list() -> None:
    growing: list[int] = []
    thing = Thing(growing, [1, 2])
    assert lengths(thing) == 2
    growing.append(1)
    assert lengths(thing) == 3


ROOT = Path(__file__).resolve().parents[3]


def test_committed_costs_are_within_their_ceilings() -> None:
    costs = read()
    rows = [*costs.drives, *costs.hardest]
    assert [excess for cost in rows for excess in excesses(costs.build, cost)] == []
    assert [cost for cost in rows if not cost.equal] == []
    assert {cost.navigator for cost in costs.drives} == set(NAVIGATORS)
    assert {cost.navigator for cost in costs.hardest} == set(NAVIGATORS)


def test_committed_states_of_all_navigators_are_within_their_ceiling() -> None:
    sizes = read().state_bytes
    assert set(sizes) == set(NAVIGATORS)
    assert max(sizes.values()) <= STATE_BYTES


@each(
    ("change", "name"),
    [
        ({"command_ms": 51.0}, "command path"),
        ({"whole_ms": 51.0}, "whole tick"),
        ({"heap_live": RAM_BYTES}, "live heap"),
        ({"stack": 10_000}, "stack"),
        ({"heap_peak": RAM_BYTES}, "RAM"),
    ],
)
def test_each_figure_has_a_ceiling(change: dict[str, float], name: str) -> None:
    costs = read()
    cheap = cost_of("vgm")
    assert excesses(costs.build, cheap) == []
    found = excesses(costs.build, msgspec.structs.replace(cheap, **change))
    assert any(f"vgm in box: {name}" in words for words in found)


def test_flash_has_a_ceiling() -> None:
    build = msgspec.structs.replace(read().build, flash=FLASH_BYTES + 1)
    assert any("flash" in words for words in excesses(build, cost_of("bug")))


def test_ceilings_leave_room_in_the_period() -> None:
    assert set(CEILINGS) == set(NAVIGATORS)
    for ceiling in CEILINGS.values():
        assert ceiling.command_ms <= ceiling.whole_ms <= 50.0


def test_committed_digests_are_equal_for_every_drive() -> None:
    compared = on_board.read(on_board.RESULTS)
    assert compared.missing() == []
    assert compared.differing() == []


def test_single_precision_was_driven_with_every_navigator() -> None:
    found = float32.read()
    assert {one.navigator for one in found} == set(NAVIGATORS)
    assert {one.world for one in found} <= set(shipped())


def test_page_is_made_from_the_committed_results() -> None:
    committed = ROOT / "docs" / "evidence" / "microcontroller.md"
    assert committed.read_text(encoding="utf-8") == microcontroller_page.document()


def test_results_are_written_as_they_are_read(tmp_path: Path) -> None:
    costs = read()
    results.write(costs, tmp_path / "cost.json")
    assert read(tmp_path / "cost.json") == costs


def cost_of(navigator: str) -> Cost:
    return Cost(
        navigator=navigator, world="box", ticks=2, equal=True, command_instructions=1,
        whole_instructions=1, command_ms=1.0, median_ms=1.0, whole_ms=1.0,
        cycles_per_instruction=2.0, heap_live=1, heap_peak=1, allocated=1, stack=1,
    )  # fmt: skip


def result(drive: BoardDrive, image: str, time_s: float, on_board: str = "same") -> Compared:
    return Compared(*drive, "reached", time_s, "same", on_board, image, "core")


def test_drives_without_an_equal_result_of_the_image_are_run() -> None:
    drives = list(all_drives())
    rows = [
        result(drives[0], "new", 9.0),
        result(drives[1], "old", 9.0),
        result(drives[2], "old", 5.0),
        result(drives[3], "new", 50.0, on_board="another"),
    ]
    found = BoardComparison(1, rows)
    assert found.missing() == drives[4:]
    assert found.differing() == [rows[3]]
    assert found.todo("new") == [*drives[4:], drives[3], drives[2], drives[1]]


def test_new_result_replaces_that_of_the_same_drive(tmp_path: Path) -> None:
    drive, other = list(all_drives())[:2]
    found = BoardComparison(1, [result(drive, "old", 9.0), result(other, "old", 9.0)])
    found.put(result(drive, "new", 9.0))
    write(tmp_path / "digests.json", found)
    images = {one.drive: one.image for one in on_board_read(tmp_path / "digests.json").drives}
    assert images == {drive: "new", other: "old"}


def test_error_of_the_board_is_a_difference() -> None:
    drive = next(all_drives())
    assert not result(drive, "new", 9.0, on_board="the core on the board has failed").is_equal
