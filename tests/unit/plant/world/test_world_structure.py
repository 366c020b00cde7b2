from tests.support.each import each
from tests.support.plant.world_texts import (
    ROBOT_AT,
    Bad,
    assert_told,
    goal,
    more,
    start,
    with_line,
)

BAD = [
    Bad("no name", with_line(1, ""), 1, "name", "missing", 'add name = "my_world"'),
    Bad("no size", with_line(2, ""), 1, "size_m", "missing", "add size_m = [6.0, 4.0]"),
    Bad("no start", with_line(3, ""), 1, "start", "missing", "add start = {"),
    Bad("no goal", with_line(4, ""), 1, "goal", "missing", "add goal = {"),
    Bad("no goal.x_m", goal("{ y_m = 2.0 }"), 4, "goal.x_m", "missing", "add x_m = "),
    Bad("a typo", more("[robt]\n"), 20, "robt", "unknown key", "did you mean robot?"),
    Bad("a stranger", with_line(5, "xyz = 1"), 5, "xyz", "unknown key", "the keys here are name"),
    Bad(
        "centimetres",
        with_line(2, "size_cm = [600, 400]"),
        2,
        "size_cm",
        "wrong unit",
        "did you mean size_m = [6, 4]? (metres)",
    ),
    Bad(
        "radians",
        start("{ x_m = 0.6, y_m = 2.0, heading_rad = 1.5 }"),
        3,
        "start.heading_rad",
        "wrong unit",
        "did you mean heading_deg = 85.9437? (degrees)",
    ),
    Bad(
        "no unit",
        start("{ x = 0.6, y_m = 2.0 }"),
        3,
        "start.x",
        "no unit in the key",
        "did you mean x_m? (metres)",
    ),
    Bad(
        "a unit too many",
        with_line(10, "circle_m = { x_m = 4.0, y = 3.0, radius = 0.25 }"),
        10,
        "obstacle#2.circle_m.x_m",
        "wrong unit",
        "did you mean x?",
    ),
    Bad(
        "km/h",
        with_line(19, "speed_km_h = 0.36"),
        19,
        "obstacle#4.speed_km_h",
        "wrong unit",
        "did you mean speed_m_s = 0.1? (metres per second)",
    ),
    Bad("a number as name", with_line(1, "name = 3"), 1, "name", "expected text", 'name = "my'),
    Bad(
        "no name in it",
        with_line(1, 'name = ""'),
        1,
        "name",
        "is not a valid name",
        "write name = ",
    ),
    Bad(
        "blank name", with_line(1, 'name = " "'), 1, "name", "is not a valid name", "write name = "
    ),
    Bad(
        "path up",
        with_line(1, 'name = "../up"'),
        1,
        "name",
        "'../up' is not a valid name",
        "write name",
    ),
    Bad("root", with_line(1, 'name = "/etc/x"'), 1, "name", "is not a valid name", "write name = "),
    Bad("parent", with_line(1, 'name = ".."'), 1, "name", "is not a valid name", "write name = "),
    Bad("hidden", with_line(1, 'name = ".x"'), 1, "name", "is not a valid name", "write name = "),
    Bad(
        "backslash",
        with_line(1, 'name = "a\\\\b"'),
        1,
        "name",
        "is not a valid name",
        "write name = ",
    ),
    Bad(
        "two lines",
        with_line(1, 'name = "a\\nb"'),
        1,
        "name",
        "is not a valid name",
        "write name = ",
    ),
    Bad(
        "end of line",
        with_line(1, 'name = "a\\n"'),
        1,
        "name",
        "is not a valid name",
        "write name = ",
    ),
    Bad("long", with_line(1, f'name = "{"x" * 65}"'), 1, "name", "longer than 64", "write name"),
    Bad(
        "a flag as word", with_line(5, 'walls = "no"'), 5, "walls", "true or false", "walls = true"
    ),
    Bad("a word as size", with_line(2, 'size_m = "6"'), 2, "size_m", "two numbers", "[6.0, 4.0]"),
    Bad("three sizes", with_line(2, "size_m = [6, 4, 2]"), 2, "size_m", "found 3 values", "6.0"),
    Bad("a flag as x", start(ROBOT_AT % ("true", 2)), 3, "start.x_m", "a truth value", "x_m = 0.6"),
    Bad("a list as start", start("[1, 2]"), 3, "start", "expected a table", "write { x_m = 0.6"),
    Bad("a date", start(ROBOT_AT % ("2020-01-01", 2)), 3, "start.x_m", "a date", "x_m = 0.6"),
    Bad(
        "NaN", start(ROBOT_AT % ("nan", 2)), 3, "start.x_m", "nan is not finite", "a number of -100"
    ),
    Bad("infinity", goal(ROBOT_AT % ("-inf", 2)), 4, "goal.x_m", "-inf is not finite", "x_m = 0.6"),
    Bad("overflow", goal(ROBOT_AT % ("1e999", 2)), 4, "goal.x_m", "inf is not finite", "x_m = 0.6"),
    Bad(
        "far away",
        goal(ROBOT_AT % (1000, 2)),
        4,
        "goal.x_m",
        "1000 is out of range",
        "-100 to 100 m",
    ),
    Bad(
        "hex monster", goal(ROBOT_AT % ("0x" + "f" * 9999, 2)), 4, "goal.x_m", "huge", "-100 to 100"
    ),
    Bad(
        "no floor",
        with_line(2, "size_m = [0.0, 4.0]"),
        2,
        "size_m",
        "0.0 is out of",
        "0.5 to 100 m",
    ),
    Bad(
        "no tolerance",
        goal("{ x_m = 5.4, y_m = 2.0, position_tolerance_m = 0.0 }"),
        4,
        "goal.position_tolerance_m",
        "0.0 is out of range",
        "a number of 0.001 to 2 m",
    ),
    Bad(
        "a heading of many turns",
        start("{ x_m = 0.6, y_m = 2.0, heading_deg = 5000 }"),
        3,
        "start.heading_deg",
        "5000 is out of range",
        "-360 to 360 degrees",
    ),
]


@each("bad", BAD)
def test_missing_misspelt_or_mistyped_key_is_reported(bad: Bad) -> None:
    assert_told(bad, alone=True)
