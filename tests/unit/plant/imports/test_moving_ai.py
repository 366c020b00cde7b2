from hypothesis import given, settings
from hypothesis import strategies as st

from plant.imports.cells import Cells
from plant.imports.moving_ai import MAX_CELLS, MovingAiScenario, fits, parse_map, parse_scenarios
from plant.model.errors import WorldError
from tests.support.each import each
from tests.support.plant.imports.files import MAP, SCEN, refused


def cells(text: str = MAP) -> Cells:
    return parse_map(text, "hand.map", 0.4)


def test_map_has_its_first_row_at_the_top() -> None:
    found = cells()
    assert (found.columns, found.rows, found.cell_m) == (8, 5, 0.4)
    assert found.size_m == (3.2, 2.0)
    assert not found.blocked[4].any()
    assert found.blocked[3].tolist() == [False] + 5 * [True] + 2 * [False]
    assert found.blocked[2, 1]
    assert found.blocked[2, 6]


def test_only_dot_g_and_s_cells_are_free() -> None:
    row = cells("type octile\nheight 1\nwidth 7\nmap\n.GS@OTW\n").blocked[0]
    assert row.tolist() == [False] * 3 + [True] * 4


@each(
    "text",
    [
        MAP.rstrip("\n"),
        MAP + "\n\n",
        MAP.replace("height 5\nwidth 8", "width 8\nheight 5"),
        MAP.replace("\n.", "\n.", 1).replace("....\n", "....  \n"),
    ],
)
def test_tolerated_format_variations_give_the_same_map(text: str) -> None:
    assert (cells(text).blocked == cells().blocked).all()


BAD_MAPS = [
    ("empty", "", 1, "type", "expected type octile"),
    ("another type", MAP.replace("octile", "tile"), 1, "type", "found 'type tile'"),
    ("no height", MAP.replace("height 5", "hight 5"), 2, "height", "found 'hight 5'"),
    ("height zero", MAP.replace("height 5", "height 0"), 2, "height", "found 'height 0'"),
    ("height no number", MAP.replace("height 5", "height five"), 2, "height", "five"),
    ("width huge", MAP.replace("width 8", f"width {MAX_CELLS + 1}"), 3, "width", "4097"),
    ("width twice", MAP.replace("height 5", "width 8"), 3, "width", "found 'width 8'"),
    ("cut header", "type octile\nheight 5", 3, "width", "found ''"),
    ("no map", MAP.replace("map\n", ""), 4, "map", "missing"),
    ("unknown terrain", MAP.replace("GS", "GX"), 8, "map", "'X' in column 5 is no terrain"),
    ("a row too short", MAP.replace(".@@@@T..", ".@@@@T."), 6, "map", "7 cells in this row"),
    ("a row too long", MAP.replace(".@@@@T..", ".@@@@T..."), 6, "map", "9 cells in this row"),
    ("cut", MAP[: -len("........\n")], None, "map", "4 rows of cells, but height is 5"),
    ("a row too many", MAP + "........\n", None, "map", "6 rows of cells, but height is 5"),
]


@each(("story", "text", "line", "key", "reason"), BAD_MAPS)
def test_invalid_map_is_rejected_with_line_and_key(
    story: str, text: str, line: int | None, key: str, reason: str
) -> None:
    problem = refused(lambda: cells(text))
    assert (problem.file, problem.line, problem.key) == ("hand.map", line, key), story
    assert reason in problem.reason


@settings(max_examples=300)
@given(st.text(alphabet="typeoctilheghwdmap 0123458\n.@GSTWOx", max_size=80), st.integers(0, 60))
def test_any_map_text_raises_only_import_errors(noise: str, at: int) -> None:
    for text in (noise, MAP[:at] + noise, MAP[:at] + noise + MAP[at:]):
        try:
            found = cells(text)
        except WorldError:
            continue
        assert found.blocked.shape == (found.rows, found.columns)


def test_scenarios_give_start_and_goal_by_column_and_row() -> None:
    first, second = parse_scenarios(SCEN, "hand.map.scen")
    assert first == MovingAiScenario(2, "maps/hand.map", 8, 5, (0, 0), (7, 4))
    assert (second.line, second.start, second.goal) == (3, (3, 3), (0, 4))
    assert parse_scenarios(SCEN.replace("version 1", "version 1.0"), "x") == [first, second]
    assert parse_scenarios(SCEN.replace("\t", " "), "x") == [first, second]


@each(
    ("text", "line", "key", "reason"),
    [
        ("", 1, "version", "expected version 1"),
        ("version 2\n", 1, "version", "found 'version 2'"),
        ("version 1\n\n", 1, "scenario", "none in the file"),
        (SCEN.replace("\t7\t", "\t-7\t"), 2, "scenario", "whole numbers"),
        (SCEN.replace("\t7\t4\t9.0", "\t7\t4"), 2, "scenario", "9 fields"),
        (SCEN[:-8], 3, "scenario", "9 fields"),
    ],
)
def test_invalid_scenarios_are_rejected(text: str, line: int, key: str, reason: str) -> None:
    problem = refused(lambda: parse_scenarios(text, "hand.scen"))
    assert (problem.line, problem.key) == (line, key)
    assert reason in problem.reason


@each(
    ("change", "key", "reason"),
    [
        ({"width": 9}, "map", "made for 9 x 5 cells, the map has 8 x 5"),
        ({"start": (8, 0)}, "start", "(8, 0) is outside the map"),
        ({"goal": (0, 5)}, "goal", "(0, 5) is outside the map"),
        ({"goal": (1, 1)}, "goal", "(1, 1) is on a blocked cell"),
    ],
)
def test_scenario_that_does_not_fit_its_map_is_rejected(
    change: dict[str, object], key: str, reason: str
) -> None:
    scenario = parse_scenarios(SCEN, "x")[0]._replace(**change)  # type: ignore[arg-type]
    problem = refused(lambda: fits(scenario, cells(), "hand.scen"))
    assert (problem.line, problem.key, problem.reason) == (2, key, reason)
