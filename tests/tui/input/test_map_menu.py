"""Test the menu of a place on the map, by right click and by key."""

from ground.map.drawing import described, measured
from ground.map.scene import Disc, MapScene, Outline
from tests.support.each import each
from tests.support.tui.pilot import play, staged

ROOM = Outline(((0.0, 0.0), (6.0, 0.0), (6.0, 4.0), (0.0, 4.0)))
BOX = Outline(((2.0, 1.0), (3.0, 1.0), (3.0, 2.0), (2.0, 2.0)))


def test_right_click_offers_to_drive_there() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.pilot.click("#map", offset=(12, 6), button=3)
            await stage.redraw()
            assert "go here" in stage.words("choices")
            assert "measure to here" not in stage.words("choices")
            await stage.press("enter")
            assert len(stage.commands.given) == 1
            assert stage.commands.given[0].startswith("goal ")

    play(story)


@each(("number", "line"), [("1", "goal"), ("2", "wp add")])
def test_key_at_the_cursor_opens_the_menu(number: str, line: str) -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("G", "m", number)
            assert stage.commands.given[0].startswith(line)

    play(story)


def test_menu_measures_and_looks() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("G", "m", "4", "L", "m", "5")
            assert "m at 0° between both places" in stage.log()
            await stage.press("m", "3")
            assert "from the robot" in stage.words("answer")
            await stage.press("m", "5")
            assert "obstacle" in stage.words("answer")

    play(story)


@each(
    ("place", "words"),
    [
        ((2.5, 1.5), "2.5 1.5: in an obstacle"),
        ((3.1, 1.5), "3.1 1.5: at an obstacle 0.10 m away"),
        ((5.0, 2.0), "5 2: nearest obstacle 0.80 m away, older echo"),
        ((4.5, 3.0), "4.5 3: in an obstacle"),
    ],
)
def test_look_names_what_is_there(place: tuple[float, float], words: str) -> None:
    pillar = Disc(4.5, 3.0, 0.3179)
    scene = MapScene(obstacles=(ROOM, BOX, pillar), seen_old=((5.1, 2.0),))
    assert described(scene, place, 0.15) == words


def test_look_at_an_empty_map() -> None:
    assert described(MapScene(), (1.0, 2.0), 0.1) == "1 2: nothing known"


def test_heading_of_a_measurement_is_counter_clockwise_from_x() -> None:
    assert measured((1.0, 1.0), (1.0, 3.0)) == "2.00 m at 90°"
