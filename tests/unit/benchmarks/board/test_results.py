"""The committed measurements of the board are within their ceilings, and on the page."""

from pathlib import Path

import msgspec

from checks.same_bits import on_board
from checks.site import microcontroller_page
from checks.speed.board import float32, results
from checks.speed.board.results import (
    CEILINGS,
    FLASH_BYTES,
    RAM_BYTES,
    STATE_BYTES,
    Cost,
    excesses,
    read,
)
from plant.world.file import shipped
from study.trial.trial import NAVIGATORS
from tests.support.each import each

ROOT = Path(__file__).resolve().parents[4]


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
