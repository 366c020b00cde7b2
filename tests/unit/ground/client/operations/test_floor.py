"""Goals and waypoints outside of the known world are errors, unless they are sent anyway."""

import json

import pytest

from ground.cli.main import parse
from ground.client.goal import destination, goal_request
from ground.client.operations.floor import Floor, floor_in, floor_of
from ground.client.operations.goals import Goto
from ground.client.operations.missions import UploadMission
from ground.client.operations.session import Session
from ground.missions.mission import Mission, Waypoint
from protocol.wire.enums import Mode
from protocol.wire.messages import GoalRequest
from runtime.errors import UserError
from tests.support.each import each
from tests.support.ground.client import Stage
from tests.support.ground.station.play import WORLD_TEXT

BOX = Floor("box", 6.0, 4.0)
FACTS = json.dumps({"name": "box", "size_m": [6.0, 4.0]}).encode()


def session(stage: Stage, floor: Floor | None = BOX) -> Session:
    return Session(stage.link, stage.notes, attended=True, floor=lambda: floor)


@each("place", [(100.0, 100.0), (-0.01, 1.0), (1.0, 4.01), (6.01, 1.0)])
def test_goal_outside_the_world_is_not_sent(place: tuple[float, float]) -> None:
    stage = Stage()
    with pytest.raises(UserError, match=r"outside the world box \(6 x 4 m\); --anyway"):
        Goto(goal=destination([*place])).perform(session(stage))
    assert stage.bus.requests == []


@each("place", [(0.0, 0.0), (6.0, 4.0), (3.0, 2.0)])
def test_goal_inside_the_world_is_sent(place: tuple[float, float]) -> None:
    assert Goto(goal=destination([*place])).perform(session(Stage())).ok


def test_goal_outside_the_world_may_be_sent_anyway() -> None:
    stage = Stage()
    assert Goto(goal=destination([100.0, 1.0]), anyway=True).perform(session(stage)).ok
    assert isinstance(stage.bus.requests[-1], GoalRequest)


@each(
    ("place", "refused"),
    [((2.5, 1.4), True), ((2.1, 1.9), False), ((4.2, 3.0), True), ((4.2, 3.2), False),
     ((1.0, 1.0), False), ((1.0, 3.0), False)],
)  # fmt: skip
def test_goal_in_an_obstacle_is_not_sent(place: tuple[float, float], refused: bool) -> None:
    stage, floor = Stage(), floor_in(WORLD_TEXT)
    goal, words = destination([*place]), r"lies in an obstacle of the world box; --anyway"
    if refused:
        with pytest.raises(UserError, match=words):
            Goto(goal=goal).perform(session(stage, floor))
        assert stage.bus.requests == []
    assert Goto(goal=goal, anyway=refused).perform(session(stage, floor)).ok


def test_without_a_known_world_the_robot_decides() -> None:
    assert Goto(goal=destination([100.0, 1.0])).perform(session(Stage(), None)).ok


def test_mission_names_the_waypoint_outside_the_world() -> None:
    stage = Stage()
    inside, outside = Waypoint(x_m=1.0, y_m=1.0), Waypoint(x_m=1.0, y_m=9.0)
    mission = Mission(waypoints=(inside, outside))
    with pytest.raises(UserError, match=r"waypoint 2 \(1, 9\) lies outside the world box"):
        UploadMission(mission=mission).perform(session(stage))
    assert stage.bus.requests == []


def test_floor_is_read_from_the_plant() -> None:
    assert floor_of(Stage(FACTS).link) == BOX


GOAL = {"x_m": 5.0, "y_m": 2.0, "heading_deg": None}
GOAL |= {"position_tolerance_m": 0.05, "heading_tolerance_deg": 3.0}
WITH_GOAL = json.dumps({"name": "box", "size_m": [6.0, 4.0], "goal": GOAL}).encode()


def test_goto_without_a_place_drives_to_the_goal_of_the_world() -> None:
    stage = Stage(WITH_GOAL)
    assert Goto().perform(session(stage)).ok
    request = stage.bus.requests[-1]
    assert isinstance(request, GoalRequest)
    place = destination([5.0, 2.0]).on_the_wire()
    assert request == goal_request(place, request.request_id, Mode.GUIDED)


@each("answer", [FACTS, None, b"{}", b"[]", b"\xff"])
def test_goto_without_a_place_needs_a_world_with_a_goal(answer: bytes | None) -> None:
    stage = Stage(answer)
    with pytest.raises(
        UserError, match="X Y is missing, and there is no simulation with a goal; example"
    ):
        Goto().perform(session(stage))
    assert not any(isinstance(one, GoalRequest) for one in stage.bus.requests)


def test_goal_of_the_world_is_not_that_of_a_further_robot() -> None:
    stage = Stage(WITH_GOAL)
    stage.link.robot = "r2"
    with pytest.raises(UserError, match="is that of r1; example: goto"):
        Goto().perform(session(stage))


@each("words", ["1", "--frame body", "--tol 0.2"])
def test_part_of_a_goal_is_refused_with_an_example(words: str) -> None:
    with pytest.raises(UserError, match="example: goto 2"):
        parse(["goto", *words.split()]).operation()


def test_plant_that_does_not_answer_knows_no_world() -> None:
    assert floor_of(Stage(None).link) is None


@each(
    "text",
    [
        b"",
        b"[]",
        b'{"name": 1}',
        b'{"name": 1, "size_m": [1]}',
        b"\xff",
        b'{"name": 1, "size_m": [1, 2], "obstacles": [{"circle_m": {}}]}',
        "{}",
    ],
)
def test_malformed_description_has_no_floor(text: bytes | str) -> None:
    assert floor_in(text) is None
