"""The map as it looks. What a picture should show is in the name above it."""

from dataclasses import replace
from math import pi

from ground.map import Canvas, Scene, Target, View, draw
from tests.support.ground.map.rooms import EVERYTHING, ROOM

SEEN = tuple((2.9, 1.0 + 0.1 * step) for step in range(20))


def picture(scene: Scene, view: View, ascii_only: bool = False) -> str:
    canvas = Canvas(view.columns, view.rows, ascii_only)
    draw(scene, view, canvas)
    return "\n".join(row.rstrip() for row in canvas.to_rows())


def fitted(scene: Scene, columns: int, rows: int, ascii_only: bool = False) -> str:
    return picture(scene, View.fit(scene.box(), columns, rows), ascii_only)


def expected(text: str) -> str:
    """As far to the left as the code that it stands in."""
    return "\n".join(line.removeprefix("    ") for line in text.split("\n")[1:-1])


def test_one_sees_where_the_robot_is_what_it_sees_and_where_it_goes() -> None:
    assert fitted(ROOM, 50, 16) == expected("""
        ⡤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⡄
        ⡇            ⠢⠤⠤⠤⣀                  ⡇     ⡇
        ⡇            ⠂   ⠄                  ⡇     ⡇
        ⡇            ⡁  ⠐                   ◎ goal⡇
        ⡇            ⠄ ⡀⠁    ⡏⠉⢹                  ⡇
        ⡇            ⠂⠠      ⡇ ⢸                  ⡇
        ⡇         ⢀⠔⠉⠋⠒⢄⠠ ⠂⠘⡄⡇ ⢸                  ⡇
        ⡇         ⡇ ⣼▶⠦⢬⡦⠄⠠ ⡇⡇ ⢸                  ⡇
        ⡇       ⢀⡠⠜⠫⣀⣀⡠⠊⠐ ⠄⢠⠃⡇ ⢸                  ⡇
        ⡇     ⢀⠎⠁            ⡇ ⢸                  ⡇
        ⡇    ⢀⠎              ⡇ ⢸                  ⡇
        ⡇   ⢀⠎               ⠉⠉⠉                  ⡇
        ⡇  ⢀⠎                                     ⡇
        ⡇                                         ⡇
        ⠧⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠇
    ├─────┤ 1 m                walls: simulation truth
    """)


def test_one_sees_it_without_braille_too() -> None:
    assert fitted(ROOM, 50, 16, ascii_only=True) == expected(r"""
        /-----------------------------------------|
        |            \---_                  |     |
        |            '   .                  |     |
        |            |  '                   O goal|
        |            . .'    +-+                  |
        |            '.      | |                  |
        |         ./-/-\. '||| |                  |
        |         | +>\++.. || |                  |
        |       .//\__//' .||| |                  |
        |     ./'            | |                  |
        |    ./              | |                  |
        |   ./               ---                  |
        |  ./                                     |
        |                                         |
        \-----------------------------------------|
    |-----| 1 m                walls: simulation truth
    """)


def test_a_robot_that_is_not_heard_is_a_question_mark_and_words_say_so() -> None:
    assert fitted(replace(ROOM, live=False, goal=None), 40, 9) == expected("""
             ⢠⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⢤
             ⢸                    ⢸
             ⢸          ⡖⡆        ⢸
             ⢸    ⢠⢔⡒⢆  ⡇⡇        ⢸
             ⢸   ⣀⠼⠾?⠝⠉⠁⡇⡇        ⢸
             ⢸  ⡜       ⣇⡇        ⢸
             ⢸ ⠜                  ⢸
             ⠸⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠤⠼
    ├──┤ 1 m                        NOT LIVE
    """)


def test_close_up_the_robot_is_true_to_scale_and_the_goal_a_pointer_on_the_edge() -> None:
    assert picture(ROOM, View(40, 12, 1.9, 2.0, 0.008)) == expected("""
                        ⡁   ⠐
                        ⠄  ⡀⠁              ⢀
                   ⢀⡠⠤⠒⠒⠒⠒⠤⢄⡀   goal 3.5 m⠁→
                 ⢀⠔⠁        ⠈⠢⡀  ⢀ ⠄⠐⠈
                 ⡎            ⢱ ⠂
                ⡸              ⢇
                ⢱    ⣀⠤⠒▶⠉⠉⠉⠉⠉⠉⡝⠉⠉⠉ ⠁⠈ ⠁⠈ ⠁⠈
                 ⢇⡠⠒⠉         ⡸ ⠄
              ⡠⠔⠊⠉⠢⡀        ⢀⠔⠁  ⠈ ⠂⠠⢀
          ⣀⠤⠒⠉     ⠈⠑⠒⠤⢄⣀⠤⠒⠊⠁          ⠁⠐ ⡀
      ⢀⡠⠔⠉                                 ⠈
    ├─┤ 5 cm         walls: simulation truth
    """)


def test_what_only_the_robot_saw_is_not_called_truth() -> None:
    assert fitted(
        replace(ROOM, size_m=None, obstacles=(), truth=False, seen=SEEN), 40, 9
    ) == expected("""
                  ⠐  ⠠             ◎ goal
                  ⢈  ⠂ ⢠
                 ⢀⡠⢄⡁  ⢸
                 ⡎▶⣤⣘⣄⣁⢸⡄
               ⣀⠤⠻⢍⡡⠜⠁⠂⢸⠁
              ⡜        ⢸
             ⡜         ⠘
            ⠜
    ├───┤ 1 m
    """)


def test_everything_at_once_is_crowded_but_not_lost() -> None:
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
           ⠄           ⠐    ⢀⠤⣒⠽⠕⠺⠭⡑⠒⢢ ⢀⠠ ⢆         ⠘⠤⣀⣀⠤⠊      ⠂            ⠄
           ⠂           ⡁   ⢠⠧⠊ ⣈⣌ ⡀⠸⡄⢺⠁   ⠘⡄                    ⢈            ⠂
           ⡁           ⠂  ⡔⢏  ⢰▶⣿⡧⠤⠤⢵⠜⠠ ⠄⠠ ⡇                    ⠠            ⡁
           ⠄           ⡁ ⠠⡃⣘⡔⠊⠁⠉⠉ ⡡⢲⠃⠄⡀   ⢠⠃                    ⢈            ⠄
           ⠂           ⢠H⠔⠫⢄⣈⣢⣤⣤⡴⠭⠒⠁   ⠈⠐ ⠎                     ⠤⠤⠤⣾◆⡦r2     ⠂
           ⡁         ⢀⠎⠑                  ⢀                     ⠂  ⠙⠛⠁       ⡁
           ⠄        ⢀⠎  ⢁   L             ⢀                    ⡈             ⠄
           ⠂       ⢀⠎    ⠠                               ⡠⠔⠒⠢⡀⠄              ⠂
           ⡁      ⢀⠎      ⠁⡀              ⠈             ⡎   ⢀⠈⢆              ⡁
           ⠄     ⢀⠎       ⢀ ⠂⣀  ⢀  ⠠  ⠠  ⠄  ⠂  ⠂  ⠂  ⠂  >2⢀•⠉⠉⡝⠉        ⢸    ⠄
           ⠂    ⢀•⣀1⡨⠤⠤⠬⠤⠤⠤⠤⠒⠒⠒⡒⠒⠒⠒⠉⠉⠉■ bug stuck       ⢈⠒⠤⠤⠤⠊          ⢸    ⠂
           ⡁                    ⠐⠠   ◦ d1  ⠂     ⠂    ⠄⠂    ⠐     ⠐     ◦ d2 ⡁
           ⠄                       ⠁⠐ ⠄⠠ ⡀⢀⢀ ⡀⢀ ⠄⠠ ⠂⠈                        ⠄
           ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠄ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠠ ⠄⠄⠠ ⠠ ⠄⠄ ⠄⠄ ⠄⠠⠠ ⠠⠠ ⠄ ⠄⠠ ⠄⠠ ⠄⠠ ⠄
    ├─────────┤ 1 m                                                           t 12 s
    """)


def test_a_few_cells_still_have_the_robot() -> None:
    assert fitted(ROOM, 8, 3) == expected("""
     goal⠤◎⡄
     ⡇▶⠶⡧⠤ ⡇
     ⠷⠥⠤⠥⠤⠤⠇
    """)


def test_a_draft_is_told_from_the_mission_without_any_colour() -> None:
    ways = (Target(1.0, 1.0), Target(3.0, 1.0, pi / 2.0))
    sent = fitted(Scene(size_m=(4.0, 2.0), mission=ways), 40, 9, ascii_only=True)
    made = fitted(Scene(size_m=(4.0, 2.0), draft=ways), 40, 9, ascii_only=True)
    assert ("* 1" in sent, "% d1" in sent) == (True, False)
    assert ("* 1" in made, "% d1" in made) == (False, True)
    assert made.count("|") == sent.count("|")
