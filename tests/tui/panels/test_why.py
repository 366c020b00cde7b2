"""Test the keys that explain the last turn and earlier ones."""

from protocol.wire.enums import Branch
from tests.support.ground.explain.decisions import decided
from tests.support.tui.fakes import MS, FakeStation, S
from tests.support.tui.pilot import play, staged
from tests.support.tui.underway import driving

TURNS = (Branch.TO_GOAL, Branch.PASS_RIGHT, Branch.PASS_LEFT)


def turned(ago_ns: int = 2 * S) -> FakeStation:
    """Return a station whose robot passed on the right, and `ago_ns` before now on the left."""
    station = driving(FakeStation())
    last_ns = station.now_ns - ago_ns
    station.decisions_now = [
        (last_ns + (tick - 2) * 50 * MS, decided(time_ns=tick * 50 * MS, branch=branch))
        for tick, branch in enumerate(TURNS)
    ]
    return station


def test_key_explains_the_last_turn_and_closes_again() -> None:
    async def story() -> None:
        async with staged((110, 30), station=turned()) as stage:
            await stage.press("e")
            text = stage.words("why-below")
            assert "2.0 s ago: changes the side: passes on the right" in text
            assert "so it passes on the left" in " ".join(text.split())
            await stage.press("e")
            assert not stage.app.screen.has_class("-explaining")

    play(story)


def test_other_key_explains_earlier_turns() -> None:
    async def story() -> None:
        async with staged((110, 30), station=turned()) as stage:
            for _ in range(4):
                await stage.press("E")
            assert "goes for the goal -> passes on the right" in stage.words("why-below")

    play(story)


def test_robot_without_turns_has_no_explanation() -> None:
    async def story() -> None:
        async with staged((110, 30)) as stage:
            await stage.press("e")
            assert "the robot has not turned yet" in stage.words("why-below")

    play(story)


def test_turns_are_collected_on_other_screens() -> None:
    async def story() -> None:
        station = turned()
        async with staged((110, 30), station=station) as stage:
            await stage.press("4")
            station.decisions_now.append(
                (station.now_ns - S, decided(time_ns=150 * MS, branch=Branch.TO_GOAL))
            )
            station.decisions_now.append(
                (station.now_ns - S + 50 * MS, decided(time_ns=200 * MS, branch=Branch.TO_GOAL))
            )
            await stage.press("1", "e")
            turn = "1.0 s ago: passes on the left -> goes for the goal"
            await stage.until_shown("why-below", turn)

    play(story)
