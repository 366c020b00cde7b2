"""An instant as the words of a trial: what is read back is the same place to the last bit."""

import json
from math import pi

from hypothesis import given
from hypothesis import strategies as st

from ground.client.goal import Destination, destination
from ground.ghost.branch_point import BranchPoint, driving, trial_words, world_bytes
from protocol.options import numbers_kept
from protocol.outcome import rounded_heading_rad
from robot.core.parameters import DEFAULTS
from study.cli.trial import goal_of, parser, start_of

PLACES = st.floats(-2000.0, 2000.0)
TURNS = st.floats(-pi, pi)
GOALS = st.builds(
    Destination,
    x_m=PLACES,
    y_m=PLACES,
    heading_rad=st.none() | TURNS,
    position_tolerance_m=st.floats(0.001, 1.0),
    heading_tolerance_rad=st.floats(0.01, 3.14),
)
GOAL = destination([5.4, 2.0, 0.0])


@given(st.tuples(PLACES, PLACES, TURNS), st.floats(0.0, 86_400.0), GOALS)
def test_start_time_and_goal_arrive_as_they_were(
    start: tuple[float, float, float], at_s: float, goal: Destination
) -> None:
    words = trial_words(BranchPoint("box", start, at_s, goal), "bug", {"seed": 3, "side": None})
    options = parser().parse_args(numbers_kept(words[1:]))
    found, place = start_of(options.start), goal_of(options)
    assert found is not None
    assert place is not None
    assert (found.x_m, found.y_m, options.at) == (*start[:2], at_s)
    assert abs(found.heading_rad - start[2]) < 1e-10
    assert rounded_heading_rad(found.heading_rad) == rounded_heading_rad(start[2])
    again = Destination(
        x_m=place.x_m,
        y_m=place.y_m,
        heading_rad=place.heading_rad,
        position_tolerance_m=place.position_tolerance_m,
        heading_tolerance_rad=place.heading_tolerance_rad,
    )
    assert again.on_the_wire() == goal.on_the_wire()
    assert (options.navigator, options.seed, options.side) == ("bug", 3, "left")
    assert (options.trace, options.json) == ("-", True)


def test_world_is_passed_by_name_or_by_its_facts() -> None:
    named = BranchPoint("u_trap", (0.6, 2.0, 0.0), 0.0, GOAL)
    told = named._replace(world={"name": "told"})
    assert "u_trap" in trial_words(named, "bug", {})
    assert world_bytes(named) == b""
    assert trial_words(told, "bug", {})[trial_words(told, "bug", {}).index("--world") + 1] == "-"
    assert json.loads(world_bytes(told)) == {"name": "told"}


def test_how_a_robot_is_built_and_what_it_runs_is_not_handed_on() -> None:
    kept = driving({name: float(value) for name, value in DEFAULTS._asdict().items()})
    assert {"d_obs_m", "v_max_m_s", "guard_stop_m", "follow_m"} <= set(kept)
    assert not {"navigator", "side", "wheel_ratio", "k_r_m", "track_m"} & set(kept)
