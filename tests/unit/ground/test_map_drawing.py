"""Whole maps: scenes, kept layers, the legend, and pictures that are named by their tests."""

from collections.abc import Collection, Iterable
from dataclasses import replace
from math import inf, nan, pi
from time import thread_time
from typing import Final

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ground.map import drawing
from ground.map.canvas import Canvas
from ground.map.drawing import (
    NOT_LIVE,
    KeptLayers,
    draw,
    draw_moving,
    draw_static,
    draw_traces,
    legend,
    length_text,
    static_parts,
)
from ground.map.pen import ellipse
from ground.map.scene import (
    LAYERS,
    Disc,
    GhostTrail,
    MapScene,
    MapTarget,
    Outline,
    RobotMark,
    View,
    floor,
)
from ground.station.history.trail import DrivenPath
from tests.support.each import each

ROOM: Final = MapScene(
    size_m=(6.0, 4.0),
    obstacles=(
        Outline(floor((6.0, 4.0))),
        Outline(((3.0, 1.0), (3.4, 1.0), (3.4, 3.0), (3.0, 3.0))),
    ),
    robot=RobotMark(1.9, 2.0, 0.0, 0.12),
    ranges_m=(inf, inf, None, 0.9, 0.9, inf, inf, 1.6),
    trail=((0.5, 0.5), (1.0, 1.5), (1.9, 2.0)),
    goal=MapTarget(5.2, 3.2, pi / 2.0),
    zone_m=0.3,
)

EVERYTHING: Final = replace(
    ROOM,
    obstacles=(),
    truth=False,
    seen=((2.9, 1.0), (2.9, 1.2), (2.9, 1.4)),
    seen_late=((3.1, 1.0), (3.1, 1.2)),
    seen_old=((3.3, 1.0), (3.3, 1.2)),
    true_robot=RobotMark(2.2, 2.2, 0.1, 0.12),
    covariance=(0.05, 0.02, 0.03),
    virtual_goal=(2.0, 3.4),
    hits=((1.2, 1.6),),
    leaves=((1.6, 1.2),),
    fence=(Disc(3.0, 2.0, 1.9),),
    mission=(MapTarget(0.6, 0.6), MapTarget(4.4, 0.8, 0.0, 0.3)),
    current=1,
    draft=(MapTarget(2.4, 0.4), MapTarget(5.6, 0.4, pi / 2.0)),
    movers=(Disc(4.0, 2.6, 0.3),),
    others=(RobotMark(5.2, 1.6, pi, 0.12, name="r2"),),
    ghosts=(GhostTrail("bug", ((0.5, 0.5), (2.5, 0.6)), "stuck"),),
    cursor=(0.4, 3.6),
    note="t 12 s",
)


ANY = st.floats(allow_nan=True, allow_infinity=True)
POINTS = st.tuples(ANY, ANY)
MANY = st.lists(POINTS, max_size=4).map(tuple)
SHAPES = st.builds(Outline, MANY, st.booleans()) | st.builds(Disc, ANY, ANY, ANY)
ROBOTS = st.builds(RobotMark, ANY, ANY, ANY, ANY, st.text(max_size=5))
TARGETS = st.builds(MapTarget, ANY, ANY, st.none() | ANY, ANY)
SCENES = st.builds(
    MapScene,
    size_m=st.none() | POINTS,
    obstacles=st.lists(SHAPES, max_size=3).map(tuple),
    truth=st.booleans(),
    seen=MANY,
    trail=MANY,
    robot=st.none() | ROBOTS,
    live=st.booleans(),
    covariance=st.none() | st.tuples(ANY, ANY, ANY),
    ranges_m=st.lists(st.none() | ANY, max_size=8),
    zone_m=st.none() | ANY,
    goal=st.none() | TARGETS,
    virtual_goal=st.none() | POINTS,
    hits=MANY,
    leaves=MANY,
    fence=st.lists(SHAPES, max_size=3),
    mission=st.lists(TARGETS, max_size=3),
    current=st.none() | st.integers(),
    draft=st.lists(TARGETS, max_size=3),
    movers=st.lists(st.builds(Disc, ANY, ANY, ANY), max_size=2),
    others=st.lists(ROBOTS, max_size=2),
    ghosts=st.lists(
        st.builds(GhostTrail, st.text(max_size=5), MANY, st.text(max_size=5)), max_size=2
    ),
    cursor=st.none() | POINTS,
    note=st.text(max_size=5),
)


@given(SCENES, st.integers(0, 60), st.integers(0, 20), st.booleans())
@example(MapScene(robot=RobotMark(0.0, 0.0, 1.5e308, 0.12)), 9, 9, False)
@settings(max_examples=120, deadline=None)
def test_any_scene_can_be_drawn(scene: MapScene, columns: int, rows: int, plain: bool) -> None:
    canvas = Canvas(columns, rows, ascii_only=plain)
    draw(scene, View.fit(scene.box(), columns, rows), canvas)
    assert [len(row) for row in canvas.to_rows()] == [columns] * rows
    assert not plain or "".join(canvas.to_rows()).isascii()


ROLES_OF = {
    "walls": {"truth"},
    "seen": {"seen", "seen late", "seen old"},
    "fence": {"fence"},
    "draft": {"draft"},
    "ghosts": {"ghost"},
    "trail": {"trail"},
    "ellipse": {"ellipse"},
    "zone": {"zone"},
    "sonars": {"cone", "echo", "dead sonar"},
    "marks": {"hit", "leave"},
    "mission": {"mission"},
    "virtual": {"virtual"},
    "goal": {"goal"},
    "others": {"truth", "other 2"},
    "truth": {"true robot"},
    "robot": {"robot"},
    "cursor": {"cursor"},
    "legend": {"text", "robot", "goal", "dead sonar", "seen", "true robot", "truth"},
}


@each("layer", LAYERS)
def test_each_layer_draws_its_own_and_nothing_else(layer: str) -> None:
    canvas = Canvas(80, 24)
    scene = replace(EVERYTHING, truth=True)
    draw(scene, View.fit(scene.box(), 80, 24), canvas, (layer,))
    roles = {role for row in range(24) for role, _ in canvas.strip(row)}
    assert roles - {""} == ROLES_OF[layer]


@each(
    ("sonar", "columns", "rows"),
    [(7, 0, -3), (4, 4, -1), (0, 0, 2)],
)
def test_dead_sonar_is_marked_in_its_direction(sonar: int, columns: int, rows: int) -> None:
    ranges_m = [None if one == sonar else inf for one in range(8)]
    scene = replace(ROOM, ranges_m=ranges_m)
    view, canvas = View(80, 24, 1.9, 2.0, 0.05), Canvas(80, 24)
    draw(scene, view, canvas, ("sonars", "robot"))
    at = [(row.index("×"), y) for y, row in enumerate(canvas.to_rows()) if "×" in row]
    column, line = view.cell_of(1.9, 2.0) or (0, 0)
    assert at == [(column + columns, line + rows)]
    assert "dead sonar" in {role for role, _ in canvas.strip(at[0][1])}
    late = Canvas(80, 24)
    draw(replace(scene, live=False), view, late)
    assert "×" not in "".join(late.to_rows())


def test_other_robots_have_dim_trails_and_a_mark_when_lost() -> None:
    live = RobotMark(3.0, 1.0, 0.0, name="r2", trail=((1.0, 1.0), (3.0, 1.0)))
    scene = replace(ROOM, trail=((1.0, 1.0), (1.2, 1.0)), others=(live,))
    canvas, lost = Canvas(80, 24), Canvas(80, 24)
    view = View.fit(scene.box(), 80, 24)
    draw(scene, view, canvas, ("trail", "others"))
    roles = {role for row in range(24) for role, _ in canvas.strip(row)}
    assert roles - {""} == {"trail", "trail 2", "other 2"}
    assert "◆" in "".join(canvas.to_rows())
    assert "r2" in "".join(canvas.to_rows())
    draw(replace(scene, others=(replace(live, live=False),)), view, lost)
    assert "?" in "".join(lost.to_rows())


def test_robots_of_a_small_fleet_have_their_own_colours() -> None:
    others = tuple(RobotMark(0.5 * at, 2.0, 0.0, name=f"r{at}") for at in range(1, 7))
    canvas, scene = Canvas(80, 24), replace(ROOM, robot=None, goal=None, others=others)
    draw(scene, View.fit(scene.box(), 80, 24), canvas, ("others",))
    roles = {role for row in range(24) for role, _ in canvas.strip(row)}
    assert roles - {""} == {f"other {hue}" for hue in range(6)}


def test_robot_in_need_has_its_name_in_any_crowd() -> None:
    crowd = tuple(RobotMark(3.0, 0.5 + 0.02 * at, 0.0, name=f"r{at}") for at in range(150))
    others = (*crowd, RobotMark(3.0, 2.0, 0.0, name="stopped", in_need=True))
    scene = replace(ROOM, robot=None, goal=None, others=others)
    canvas, view = Canvas(40, 12), View.fit(scene.box(), 40, 12)
    draw(scene, view, canvas, ("others",))
    column, row = view.cell_of(3.0, 2.0) or (0, 0)
    text = canvas.to_rows()
    assert text[row][column] == "!"
    assert text[row][column + 2 : column + 9] == "stopped"
    named = [word for line in text for word in line.split() if word.startswith("r")]
    assert set(named) <= {other.name for other in crowd}
    assert "! in trouble" in [words for words, _ in legend(scene, 200)]


def test_map_without_a_world_shows_all_robots() -> None:
    scene = MapScene(robot=RobotMark(0.0, 0.0, 0.0, 0.12), others=(RobotMark(9.0, 0.0, 0.0, 0.12),))
    box = scene.box()
    assert box is not None
    assert box[2] > 9.0


def test_robot_is_filled_and_covers_marks_below_it() -> None:
    at = (1.9, 2.0)
    scene = replace(ROOM, hits=(at,), mission=(MapTarget(*at),), true_robot=ROOM.robot)
    canvas = Canvas(80, 24)
    view = View.fit(scene.box(), 80, 24)
    draw(scene, view, canvas)
    column, row = view.cell_of(*at) or (0, 0)
    assert canvas.to_rows()[row][column : column + 2] == "▶⣿"
    assert "H" not in "".join(canvas.to_rows()[:-1])


@each(("ascii_only", "marks"), [(False, "▒·"), (True, ":,")])
def test_echoes_fade_by_roles_and_without_colours_by_characters(
    ascii_only: bool, marks: str
) -> None:
    scene = MapScene(seen=((0.5, 0.0),), seen_late=((1.0, 0.0),), seen_old=((1.5, 0.0),))
    view = View(40, 5, 1.0, 0.0, 0.05)
    canvas = Canvas(40, 5, ascii_only, is_mono=True)
    draw(scene, view, canvas, ("seen",))
    runs = [run for row in range(5) for run in canvas.strip(row) if run[0]]
    assert [role for role, _ in runs] == ["seen", "seen late", "seen old"]
    assert [text.strip() for _, text in runs][:2] == list(marks)


def test_static_and_moving_layers_make_the_whole_scene() -> None:
    view = View.fit(EVERYTHING.box(), 80, 24)
    whole, ground = Canvas(80, 24), Canvas(80, 24)
    draw(EVERYTHING, view, whole)
    draw_static(EVERYTHING, view, ground)
    both = ground.copy()
    draw_traces(EVERYTHING, view, both)
    draw_moving(EVERYTHING, view, both)
    assert both.changed_rows(whole) == []
    assert static_parts(replace(EVERYTHING, robot=None)) == static_parts(EVERYTHING)


def test_robot_without_a_position_is_not_drawn() -> None:
    unknown = replace(ROOM, size_m=None, obstacles=(), trail=(), goal=None)
    for robot in (None, RobotMark(nan, 1.0, 0.0, 0.12), RobotMark(1.0, inf, 0.0, 0.12)):
        canvas = Canvas(40, 5)
        draw(replace(unknown, robot=robot), View(40, 5), canvas)
        assert "".join(canvas.to_rows()).strip() == ""


def test_trail_has_a_gap_at_a_missing_position() -> None:
    canvas = Canvas(20, 1)
    scene = MapScene(trail=((-0.9, 0.0), (-0.6, 0.0), (nan, 0.0), (0.6, 0.0), (0.9, 0.0)))
    draw(scene, View(20, 1, 0.0, 0.0, 0.05), canvas)
    assert canvas.to_rows() == [" ⠤⠤⠤⠄           ⠤⠤⠤⠄"]


def test_old_echoes_are_not_drawn() -> None:
    canvas = Canvas(50, 16)
    draw(replace(ROOM, live=False), View.fit(ROOM.box(), 50, 16), canvas)
    roles = {role for row in range(16) for role, _ in canvas.strip(row)}
    assert not roles & {"cone", "echo"}


def test_a_huge_world_is_drawn_as_fast() -> None:
    huge = replace(ROOM, size_m=(1e7, 1e7), zone_m=1e6, trail=((0.0, 0.0), (1e300, 1e300)))
    for view in (View.fit(huge.box(), 100, 40), View(100, 40, 1.9, 2.0, 1e-4)):
        begun_s = thread_time()
        draw(huge, view, Canvas(100, 40))
        assert thread_time() - begun_s < 1.0


@given(ANY, ANY, ANY)
@settings(deadline=None)
def test_ellipse_axes_are_ordered_for_any_covariance(xx: float, xy: float, yy: float) -> None:
    axes = ellipse((xx, xy, yy))
    if axes is not None:
        assert axes[0] >= axes[1] >= 0.0


def test_ellipse_contains_95_percent() -> None:
    long_m, short_m, turn_rad = ellipse((0.04, 0.0, 0.01)) or (0.0, 0.0, 0.0)
    assert (long_m, short_m, turn_rad) == pytest.approx((0.48954, 0.24477, 0.0), abs=1e-4)
    turned = ellipse((0.01, 0.0, 0.04)) or (0.0, 0.0, 0.0)
    assert turned[2] == pytest.approx(pi / 2.0)


VIEW = View(60, 20, 3.0, 2.0, 0.05)
DRIVEN = tuple((0.1 * step, 2.0 + 0.02 * step) for step in range(40))


def drawn(layers: KeptLayers, scene: MapScene, shown: Collection[str] = LAYERS) -> Canvas:
    canvas = layers.below(scene, VIEW, shown, Canvas(60, 20))
    draw_moving(scene, VIEW, canvas, shown)
    return canvas


def drawn_anew(scene: MapScene, shown: Collection[str] = LAYERS) -> Canvas:
    canvas = Canvas(60, 20)
    draw(scene, VIEW, canvas, shown)
    return canvas


def test_kept_layers_equal_a_new_drawing() -> None:
    layers = KeptLayers()
    without_trail = frozenset(LAYERS) - {"trail"}
    scenes = [replace(EVERYTHING, trail=DRIVEN[:count]) for count in (0, 1, 10, 11, 40, 40, 5)]
    scenes += [
        replace(EVERYTHING, trail=DRIVEN[::2]),
        replace(EVERYTHING, trail=DRIVEN, seen=((1.0, 1.0),)),
        replace(EVERYTHING, trail=DRIVEN, others=()),
        replace(EVERYTHING, trail=DRIVEN, obstacles=()),
    ]
    for scene in scenes:
        assert drawn(layers, scene).changed_rows(drawn_anew(scene)) == []
    for shown in (without_trail, LAYERS):
        found = drawn(layers, scenes[-1], shown)
        assert found.changed_rows(drawn_anew(scenes[-1], shown)) == []


def test_new_echoes_are_drawn_beneath_the_trail() -> None:
    layers = KeptLayers()
    echoes = tuple((x_m + 0.01, y_m) for x_m, y_m in DRIVEN[::3])
    for count in (0, 1, 5, 9, len(echoes), 2):
        scene = replace(EVERYTHING, trail=DRIVEN[: 4 * count], seen=echoes[:count])
        assert drawn(layers, scene).changed_rows(drawn_anew(scene)) == []


def test_kept_trails_of_others_equal_a_new_drawing() -> None:
    layers, other = KeptLayers(), RobotMark(5.0, 3.0, 0.0, 0.12, name="r2")
    for count in (0, 1, 2, 9, 10, 40, 40, 3):
        others = (replace(other, trail=DRIVEN[:count]), replace(other, name="r3", x_m=4.0))
        scene = replace(EVERYTHING, others=others)
        assert drawn(layers, scene).changed_rows(drawn_anew(scene)) == []
    scene = replace(EVERYTHING, others=(replace(other, trail=DRIVEN[::2]),))
    assert drawn(layers, scene).changed_rows(drawn_anew(scene)) == []


def test_of_the_trails_of_others_only_new_ends_are_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[list[int]] = []

    def note(scene: MapScene, *_: object, drawn: Iterable[int] = ()) -> None:
        begun.append(list(drawn))

    monkeypatch.setattr(drawing, "draw_other_trails", note)
    layers, path = KeptLayers(), DrivenPath(size=20)
    for step in range(60):
        path.add(0.1 * step, 2.0)
        others = (RobotMark(5.0, 3.0, 0.0, trail=path.points()),)
        drawn(layers, replace(EVERYTHING, others=others))
    assert begun[:3] == [[], [1], [2]]
    assert [] not in begun[1:]
    assert len(path.points()) <= 20


def test_only_the_new_ends_of_echoes_and_trail_are_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    starts: list[tuple[int, int] | None] = []

    def note(*_: object, drawn: tuple[int, int] | None = None) -> None:
        starts.append(drawn)

    monkeypatch.setattr(drawing, "draw_traces", note)
    layers = KeptLayers()
    for seen, count in ((0, 0), (0, 0), (2, 5), (2, 5), (3, 5), (3, 9), (4, 10)):
        drawn(layers, replace(EVERYTHING, seen=DRIVEN[:seen], trail=DRIVEN[:count]))
    drawn(layers, replace(EVERYTHING, seen=DRIVEN[1:4], trail=DRIVEN[1:11]))
    assert starts == [None, (0, 0), (2, 5), (3, 5), (3, 9), None]


@each(
    ("length_m", "text"),
    [
        (0.0005, "0.5 mm"),
        (0.002, "2 mm"),
        (0.02, "2 cm"),
        (0.5, "50 cm"),
        (1.0, "1 m"),
        (20.0, "20 m"),
        (5000.0, "5 km"),
    ],
)
def test_length_is_shown_in_a_fitting_unit(length_m: float, text: str) -> None:
    assert length_text(length_m) == text


def words_of(scene: MapScene, room: int) -> list[str]:
    return [words for words, _ in legend(scene, room)]


def test_legend_keeps_the_most_important_parts() -> None:
    lost = replace(ROOM, live=False, note="replay")
    assert words_of(lost, 80)[:3] == [NOT_LIVE, "replay", "◎ goal"]
    assert words_of(lost, 20) == [NOT_LIVE, "replay"]
    assert words_of(lost, 8) == [NOT_LIVE]
    assert words_of(lost, 3) == []


def test_legend_names_what_is_on_the_map() -> None:
    assert "─ truth" in words_of(ROOM, 80)
    assert words_of(MapScene(), 80) == []
    assert "─ truth" not in words_of(replace(ROOM, truth=False), 80)
    assert "H/L hit/leave" in words_of(replace(ROOM, hits=((1.0, 1.0),)), 80)
    assert "○ true robot" in words_of(replace(ROOM, true_robot=ROOM.robot), 80)


def test_legend_names_the_mark_of_a_dead_sonar_only_with_one() -> None:
    assert "× dead" in words_of(ROOM, 80)
    assert "× dead" not in words_of(replace(ROOM, ranges_m=(1.0,) * 8), 80)
    assert "× dead" not in words_of(replace(ROOM, live=False), 80)


def test_legend_in_ascii_is_ascii() -> None:
    assert all(words.isascii() for words, _ in legend(EVERYTHING, 200, ascii_only=True))


@each("m_per_dot", [1e-4, 0.0123, 0.05, 1.0, 1e6])
def test_scale_bar_has_its_stated_length(m_per_dot: float) -> None:
    canvas, view = Canvas(100, 8), View(100, 8, 0.0, 0.0, m_per_dot)
    draw(MapScene(), view, canvas)
    row = canvas.to_rows()[-1]
    length_m, cells = view.scale_bar(100 // 6)
    assert row.startswith("├" + "─" * (cells - 2) + "┤ " + length_text(length_m))
    assert cells * 2 * m_per_dot == pytest.approx(length_m, rel=0.15)


def test_a_map_of_few_rows_has_no_legend() -> None:
    canvas = Canvas(60, 4)
    draw(MapScene(live=False), View(60, 4), canvas)
    assert "".join(canvas.to_rows()).strip() == ""


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
