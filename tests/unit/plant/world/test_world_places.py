from tests.support.each import each
from tests.support.plant.world_texts import ROBOT_AT, Bad, assert_told, goal, more, start

BAD = [
    Bad(
        "start in the polygon",
        start(ROBOT_AT % (2.5, 1.2)),
        3,
        "start",
        "(2.5, 1.2) is inside obstacle#1 (line 6)",
        "keep start at least 0.12 m away",
    ),
    Bad(
        "start in the circle",
        start(ROBOT_AT % (4.1, 3.0)),
        3,
        "start",
        "inside obstacle#2 (line 9)",
        "keep start",
    ),
    Bad(
        "start on the wall",
        start(ROBOT_AT % (1.5, 3.01)),
        3,
        "start",
        "inside obstacle#3 (line 12)",
        "keep start",
    ),
    Bad(
        "start where someone walks off",
        start(ROBOT_AT % (3.5, 0.5)),
        3,
        "start",
        "inside obstacle#4 (line 16)",
        "keep start",
    ),
    Bad(
        "start too near",
        start(ROBOT_AT % (1.9, 1.2)),
        3,
        "start",
        "(1.9, 1.2) is 0.1 m from obstacle#1 (line 6), less than the robot's radius of 0.12 m",
        "keep start at least 0.12 m away",
    ),
    Bad(
        "start beyond the floor",
        start(ROBOT_AT % (-0.5, 2.0)),
        3,
        "start.x_m",
        "-0.5 is outside the floor of 6 x 4 m",
        "choose x_m within 0.12 to 5.88",
    ),
    Bad(
        "start at the outer wall",
        start(ROBOT_AT % (0.6, 3.95)),
        3,
        "start.y_m",
        "3.95 is nearer to the outer wall than the robot's radius of 0.12 m",
        "choose y_m within 0.12 to 3.88",
    ),
    Bad(
        "goal in the polygon",
        goal(ROBOT_AT % (2.5, 1.2)),
        4,
        "goal",
        "inside obstacle#1 (line 6)",
        "keep goal at least 0.12 m away",
    ),
    Bad(
        "goal beyond the floor",
        goal(ROBOT_AT % (7.0, 2.0)),
        4,
        "goal.x_m",
        "7 is outside the floor of 6 x 4 m",
        "choose x_m within 0.12 to 5.88",
    ),
    Bad(
        "a robot too wide for its start",
        more("[robot]\nradius_m = 0.7\n"),
        3,
        "start.x_m",
        "nearer to the outer wall than the robot's radius of 0.7 m",
        "within 0.7 to 5.3",
    ),
]


@each("bad", BAD)
def test_blocked_start_or_goal_is_rejected(bad: Bad) -> None:
    assert_told(bad, alone=False)
