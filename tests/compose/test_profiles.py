"""Several robots, the black box, measurements and tests: what a profile adds."""

from pathlib import Path
from typing import Final

import pytest

from tests.compose.compose import BUILD_S, Compose, docker, project

pytestmark = pytest.mark.compose

MANY: Final = ("r1", "r2", "r3")


def status_of(compose: Compose, robot: str) -> dict[str, object]:
    """What a robot says of itself; nothing when it is not heard."""
    seen = compose.verb("watch", "--json", "--id", robot).object
    found: dict[str, object] = seen["streams"]["tlm/odometry"]["message"] or {}
    return found


def test_scaled_robots_have_names_and_places_of_their_own_in_one_world(image: str) -> None:
    with project(image) as compose:
        compose.up("--scale", "robot=3")
        for number, name in enumerate(MANY, start=1):
            log = docker("logs", compose.container("robot", number))
            assert f"robot {name}: ready" in log
        assert "plant: world box with r1, r2, r3" in compose.logs("plant")
        places = {(seen["x_m"], seen["y_m"]) for seen in (status_of(compose, r) for r in MANY)}
        assert len(places) == len(MANY)
        # Back after a death, it is whom it was.
        compose.inside("robot", "sh", "-c", "kill -9 -1", number=2)
        compose.becomes("healthy", "robot", 2)
        assert "robot r2: ready" in docker("logs", compose.container("robot", 2))


def test_a_fleet_drives_each_robot_to_its_goal_and_all_is_recorded(
    image: str, tmp_path: Path
) -> None:
    with project(image, "fleet", "record", settings={"ROBOTS": "2", "WORLD": "open"}) as compose:
        compose.does("up", "-d", "--no-build")
        for number in (1, 2):
            assert docker("wait", compose.container("drive", number)).strip() == "0"
            assert "reached" in docker("logs", compose.container("drive", number))
        compose.does("stop", "record")
        compose.does("cp", "record:/recordings", str(tmp_path))
        robots = sorted(path.stem.rpartition("-")[2] for path in tmp_path.rglob("*.mcap"))
    assert robots == ["r1", "r2"]


def test_measurements_run_in_the_image(image: str) -> None:
    with project(image) as compose:
        done = compose.tries("run", "--rm", "-T", "--no-deps", "bench", "codec")
    assert done.code == 0, done.said


def test_the_tests_run_in_an_image_of_their_own(image: str) -> None:
    with project(image) as compose:
        compose.does("build", "tests", within_s=BUILD_S)
        done = compose.tries("run", "--rm", "-T", "tests", "-q", "tests/bus/test_health.py")
        docker("rmi", "--force", f"{image}-tests")
    assert (done.code, " passed" in done.said) == (0, True), done.said
