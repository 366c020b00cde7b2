"""Compare whole maps with pictures, named by their tests."""

from dataclasses import replace
from math import inf, pi

from ground.map.canvas import Canvas
from ground.map.drawing import draw
from ground.map.scene import MapScene, MapTarget
from ground.map.view import View
from tests.support.ground.map.rooms import EVERYTHING, ROOM

SEEN = tuple((2.9, 1.0 + 0.1 * step) for step in range(20))


def picture(scene: MapScene, view: View, ascii_only: bool = False) -> str:
    canvas = Canvas(view.columns, view.rows, ascii_only)
    draw(scene, view, canvas)
    return "\n".join(row.rstrip() for row in canvas.to_rows())


def fitted(scene: MapScene, columns: int, rows: int, ascii_only: bool = False) -> str:
    return picture(scene, View.fit(scene.box(), columns, rows), ascii_only)


def expected(text: str) -> str:
    """Remove the indent of the code."""
    return "\n".join(line.removeprefix("    ") for line in text.split("\n")[1:-1])


def test_picture_of_robot_sonars_and_goal() -> None:
    assert fitted(ROOM, 50, 16) == expected("""
        ⡤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⡄
        ⡇            ⠢⠤⠤⠤⣀                  ⡇     ⡇
        ⡇            ⠂   ⠄                  ⡇     ⡇
        ⡇            ⡁  ⠐                   ◎ goal⡇
        ⡇            ⠄ ⡀⠁    ⡏⠉⢹                  ⡇
        ⡇            ⠂⠠      ⡇ ⢸                  ⡇
        ⡇         ⢀⠔⠉⠋⠒⢄⠠ ⠂⠘⡄⡇ ⢸                  ⡇
        ⡇         ⡇ ⣼▶⠦⢬⡦⠄⠠ ⡇⡇ ⢸                  ⡇
        ⡇       ⢀⡠⠜⠫⣀⣀⡠⠊× ⠄⢠⠃⡇ ⢸                  ⡇
        ⡇     ⢀⠎⠁            ⡇ ⢸                  ⡇
        ⡇    ⢀⠎              ⡇ ⢸                  ⡇
        ⡇   ⢀⠎               ⠉⠉⠉                  ⡇
        ⡇  ⢀⠎                                     ⡇
        ⡇                                         ⡇
        ⠧⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠇
    ├─────┤ 1 m  ▶ robot  ◎ goal  × dead  ─ truth
    """)


def test_picture_in_ascii() -> None:
    assert fitted(ROOM, 50, 16, ascii_only=True) == expected(r"""
        /-----------------------------------------|
        |            \---_                  |     |
        |            '   .                  |     |
        |            |  '                   O goal|
        |            . .'    +-+                  |
        |            '.      | |                  |
        |         ./-/-\. '||| |                  |
        |         | +>\++.. || |                  |
        |       .//\__//X .||| |                  |
        |     ./'            | |                  |
        |    ./              | |                  |
        |   ./               ---                  |
        |  ./                                     |
        |                                         |
        \-----------------------------------------|
    |-----| 1 m  > robot  O goal  X dead  - truth
    """)


def test_picture_of_a_robot_that_is_not_live() -> None:
    assert fitted(replace(ROOM, live=False, goal=None), 40, 9) == expected("""
             ⢠⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⢤
             ⢸                    ⢸
             ⢸          ⡖⡆        ⢸
             ⢸    ⢠⢔⡒⢆  ⡇⡇        ⢸
             ⢸   ⣀⠼⠾?⠝⠉⠁⡇⡇        ⢸
             ⢸  ⡜       ⣇⡇        ⢸
             ⢸ ⠜                  ⢸
             ⠸⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠼
    ├──┤ 1 m  NOT LIVE  ─ truth
    """)


def test_picture_close_up_with_a_pointer_to_the_goal() -> None:
    assert picture(ROOM, View(40, 12, 1.9, 2.0, 0.008)) == expected("""
                        ⡁   ⠐
                        ⠄  ⡀⠁              ⢀
                   ⢀⣠⣤⣶⣶⣶⣶⣤⣄⡀   goal 3.5 m⠁→
                 ⢀⣴⣿⣿⣿⣿⣿⣿⣿⣿⣿⣿⣦⡀  ⢀ ⠄⠐⠈
                 ⣾⣿⣿⣿⣿⣿⣿⣿⣿⣿⣿⣿⣿⣷⡀⠂
                ⡸⣿⣿⣿⣿⣿⣿⣿⣿⣿⣿⣿⣿⣿⣿⣇
                ⢹⣿⣿⣿⣿⣿⣿⣿▶⣿⣿⣿⣿⣿⣿⡟⠉⠉⠉ ⠁⠈ ⠁⠈ ⠁⠈
                 ⢿⣿⣿⣿⣿⣿⣿⣿⣿⣿⣿⣿⣿⣿⠃⠄
              ⡠⠔⠊⠉⠻⣿⣿⣿⣿⣿⣿⣿⣿⣿⣿⡿⠃ ×⠈ ⠂⠠⢀
          ⣀⠤⠒⠉     ⠈⠙⠻⠿⢿⣿⠿⠿⠛⠉          ⠁⠐ ⡀
      ⢀⡠⠔⠉                                 ⠈
    ├─┤ 5 cm  ▶ robot  ◎ goal  × dead
    """)


def test_legend_does_not_call_seen_points_truth() -> None:
    well = replace(ROOM, ranges_m=[inf if one is None else one for one in ROOM.ranges_m])
    assert fitted(
        replace(well, size_m=None, obstacles=(), truth=False, seen=SEEN), 40, 9
    ) == expected("""
                  ⠐  ⠠             ◎ goal
                  ⢈  ⠂ ⢠
                 ⢀⡠⢄⡁  ⢸
                 ⡎▶⣤⣘⣄⣁⢸⡄
               ⣀⠤⠻⢍⡡⠜⠁⠂⢸⠁
              ⡜        ⢸
             ⡜         ⠘
            ⠜
    ├───┤ 1 m  ▶ robot  ◎ goal  ⠿ seen
    """)


def test_picture_of_everything_at_once() -> None:
    assert fitted(EVERYTHING, 80, 24) == expected("""
           ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄
           ⠂                       ⡀⠠ ⠂⠐ ⠁⠈ ⠁⠁⠈ ⠂⠐ ⠄⢀                        ⠂
           ⡁   ✛ 0.40 3.60     ⢈⠩⠙⠉⠑⠒⠤⢄⡀              ⠂⠄            ⡄        ⡁
           ⠄                  ⠄⠡ ◇ virtual              ⠈⠠          ⡇        ⠄
           ⠂                ⠄⠁ ⢈⢀    ⡀⠁                   ⠈⠠        ◎ goal   ⠂
           ⡁              ⡀⠁   ⠠⠠   ⠐                       ⠈⢀               ⡁
           ⠄             ⠐     ⠐⠠  ⢀⠁               ⢀⡠⠤⠤⢄⡀    ⠂              ⠄
           ⠂            ⡈      ⢈⠄  ⠄               ⢀⠎    ⠸⡀    ⢁             ⠂
           ⡁           ⠠       ⠠⠄ ⡈                ⠘⡄  ● ⢠⠃     ⠄            ⡁
           ⠄           ⠐    ⢀⠤⣒⠽⠕⠺⢭⣑⠒⢢ ⢀⠠ ⢆         ⠘⠤⣀⣀⠤⠊      ⠂            ⠄
           ⠂           ⡁   ⢠⠧⠊ ⣈⣌⠐⣿⣿⡗⢺⠉⠁  ⠘⡄                    ⢈            ⠂
           ⡁           ⠂  ⡔⢏  ⢰▶⣿⡧⠤⠤⢵⠜⠠ ⠄⠠ ⡇                    ⠠            ⡁
           ⠄           ⡁ ⠠⡃⣘⡔⠊⠁⠉⠉ ⡡×⠃⠄⡀   ⢠⠃                    ⢈            ⠄
           ⠂           ⢠H⠔⠫⢄⣈⣢⣤⣤⡴⠭⠒⠁   ⠈⠐ ⠎                     ⠤⠤⠤⣾◆⡦r2     ⠂
           ⡁         ⢀⠎⠑                  ⢀                     ⠂  ⠙⠛⠁       ⡁
           ⠄        ⢀⠎  ⢁   L             ⢀  ⡀ ⡀               ⡈             ⠄
           ⠂       ⢀⠎    ⠠                               ⡠⠔⠒⠢⡀⠄              ⠂
           ⡁      ⢀⠎      ⠁⡀              ⠈  ⠁ ⠁        ⡎   ⢀⠈⢆              ⡁
           ⠄     ⢀⠎       ⢀ ⠂⣀  ⢀  ⠠  ⠠  ⠄  ⠂  ⠂  ⠂  ⠂  >2⢀•⠉⠉⡝⠉        ⢸    ⠄
           ⠂    ⢀•⣀1⡨⠤⠤⠬⠤⠤⠤⠤⠒⠒⠒⡒⠒⠒⠒⠉⠉⠉■ bug stuck       ⢈⠒⠤⠤⠤⠊          ⢸    ⠂
           ⡁                    ⠐⠠   ◦ d1  ⠂     ⠂    ⠄⠂    ⠐     ⠐     ◦ d2 ⡁
           ⠄                       ⠁⠐ ⠄⠠ ⡀⢀⢀ ⡀⢀ ⠄⠠ ⠂⠈                        ⠄
           ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠄ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠄⠠ ⠠ ⠄⠄ ⠄⠄ ⠄⠠⠠ ⠠⠠ ⠄ ⠄⠠ ⠄⠠ ⠄⠠ ⠄
    ├─────────┤ 1 m  t 12 s  ▶ robot  ◎ goal  × dead  ○ true robot  ⠿ seen
    """)


def test_picture_in_a_few_cells_has_the_robot() -> None:
    assert fitted(ROOM, 8, 3) == expected("""
     goal⠤◎⡄
     ⡇▶⠶⡧⠤ ⡇
     ⠷⠥⠤⠥×⠤⠇
    """)


def test_draft_and_mission_differ_without_colours() -> None:
    ways = (MapTarget(1.0, 1.0), MapTarget(3.0, 1.0, pi / 2.0))
    sent = fitted(MapScene(size_m=(4.0, 2.0), mission=ways), 40, 9, ascii_only=True)
    made = fitted(MapScene(size_m=(4.0, 2.0), draft=ways), 40, 9, ascii_only=True)
    assert ("* 1" in sent, "% d1" in sent) == (True, False)
    assert ("* 1" in made, "% d1" in made) == (False, True)
    assert made.count("|") == sent.count("|")
