"""Several robots, the black box, measurements and tests: what a profile adds."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest

from tests.support.compose.compose import BUILD_S, LAST_WORDS, Compose, docker, project
from tests.support.until import until

pytestmark = pytest.mark.compose

TRIES: Final = 12


@pytest.fixture(scope="module")
def fleet(image: str) -> Iterator[Compose]:
    """Start two robots with a recorder each."""
    settings = {"ROBOTS": "2", "WORLD": "open"}
    with project(image, "record", settings=settings) as compose:
        compose.up()
        yield compose


def pose_of(compose: Compose, robot: str) -> tuple[float, float]:
    """Return the estimated position of a robot, rounded to centimetres."""
    seen = compose.verb("watch", "--json", "--id", robot).object
    pose = seen["streams"]["tlm/odometry"]["message"]
    return round(pose["x_m"], 2), round(pose["y_m"], 2)


def test_robots_of_one_world_have_names_and_places_of_their_own(fleet: Compose) -> None:
    assert "plant: world open with r1, r2" in fleet.logs("plant")
    for number in (1, 2):
        said = docker("logs", fleet.container("robot", number))
        assert f"robot r{number}: ready" in said
    assert pose_of(fleet, "r1") != pose_of(fleet, "r2")


def test_restarted_robot_keeps_its_name(fleet: Compose) -> None:
    fleet.inside("robot", "sh", "-c", "kill -9 -1", number=2)
    until(lambda: fleet.inspected("robot", 2)["RestartCount"] == 1, 30.0, "another r2")
    fleet.becomes("healthy", "robot", 2)
    assert docker("logs", fleet.container("robot", 2)).count("robot r2: ready") == 2


def test_each_robot_of_a_fleet_drives_to_its_goal(fleet: Compose) -> None:
    arrived: set[str] = set()
    for _ in range(TRIES):  # a busy machine may stop a robot: it goes on from there
        fleet.does("--profile", "fleet", "up", "-d", "--no-build", "drive")
        for robot in ("r1", "r2"):
            driver = fleet.container("drive", int(robot[1:]))
            if docker("wait", driver).strip() == "0":
                arrived.add(robot)
            elif robot not in arrived:
                fleet.arms("--id", robot)
        if len(arrived) == 2:
            break
    assert arrived == {"r1", "r2"}, fleet.logs("drive")[-LAST_WORDS:]


def test_what_each_robot_did_is_recorded(fleet: Compose, tmp_path: Path) -> None:
    fleet.does("stop", "record")
    for number in (1, 2):
        fleet.does("cp", "--index", str(number), "record:/recordings", str(tmp_path))
    robots = {path.stem.rpartition("-")[2] for path in tmp_path.rglob("*.mcap")}
    assert robots == {"r1", "r2"}
    assert min(path.stat().st_size for path in tmp_path.rglob("*.tlog")) > 10_000


@pytest.fixture(scope="module")
def checkout(image: str) -> Iterator[Compose]:
    """Build the image with the tree and the tools."""
    with project(image) as compose:
        compose.does("build", "tests", within_s=BUILD_S)
        yield compose
        docker("rmi", "--force", f"{image}-tests")


def test_measurements_run_in_the_image_with_the_tree(checkout: Compose) -> None:
    done = checkout.tries("run", "--rm", "-T", "bench", "codec")
    assert done.code == 0, done.said


def test_the_tests_run_in_the_image_with_the_tree(checkout: Compose) -> None:
    modules = ("tests/bus/tls/test_locks.py", "tests/stack/operator/test_terminal.py")
    chosen = ("-k", "valid_certificate or poor and environment0")
    done = checkout.tries("run", "--rm", "-T", "tests", "-q", *modules, *chosen)
    assert (done.code, "2 passed" in done.said) == (0, True), done.said
