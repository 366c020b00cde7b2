"""`docker compose up`: the image, a robot that drives, failures, and refused settings."""

import asyncio
import json
import re
import socket
from collections.abc import Iterator
from contextlib import closing, suppress
from math import hypot
from pathlib import Path
from shutil import which
from time import monotonic, monotonic_ns
from typing import Any, Final

import pytest

from checks.harness.crew import Witness
from checks.harness.observer import is_still
from checks.harness.until import until
from protocol.outcome import wire_goal
from protocol.topics import COMMAND
from protocol.wire.enums import Command, GoalState, Mode, Vehicle
from protocol.wire.messages import CommandRequest, GoalRequest
from protocol.wire.reasons import Reason
from runtime.errors import NoAnswerError
from runtime.units import NS_PER_MS as MS
from runtime.units import PERIOD_MS
from tests.support import images
from tests.support.compose import (
    POLL_S,
    ROOT,
    Compose,
    Done,
    asked,
    docker,
    project,
    token_in,
    tried,
)
from tests.support.screens import DRAWN, Tmux, browsing, chromium, drawn, keep, sees

pytestmark = pytest.mark.compose

PARTS: Final = ("router", "plant", "robot", "web")
USER: Final = "10001"
ROBOTS_USER: Final = "20001"
MIB: Final = 1 << 20
SILENCE_MS: Final = 500
PLACES: Final = ((5.4, 3.2), (0.6, 2.0))
FAST_M_S: Final = 0.25
LIVING: Final = range(GoalState.ACCEPTED, GoalState.ALIGNING + 1)
LOST: Final = (Reason.TICKS_LOST, Reason.SCAN_LOST, Reason.BUDGET)
SOON_S: Final = 60.0
KILL_ALL: Final = ("sh", "-c", "kill -9 -1")
"""All processes of the container but the first, which then ends it."""


@pytest.fixture(scope="module")
def stack(image: str) -> Iterator[Compose]:
    """Start what `docker compose up` starts, and wait until it is healthy."""
    with project(image) as compose:
        compose.up()
        yield compose


@pytest.fixture(scope="module")
def wall(image: str) -> Iterator[Compose]:
    """Start the same in wall time, in which a robot stops that the others do not wait for."""
    with project(image, settings={"CLOCK": "wall"}) as compose:
        compose.up()
        yield compose


@pytest.fixture(params=PARTS)
def part(request: pytest.FixtureRequest) -> str:
    name: str = request.param
    return name


def test_the_data_of_every_part_flow(stack: Compose, part: str) -> None:
    stack.becomes("healthy", part)


def test_a_script_sends_the_robot_to_a_place(stack: Compose) -> None:
    done = stack.goes("1.2", "2.0")
    assert (done.code, done.object["outcome"]) == (0, "reached"), done.said


def test_every_verb_finds_its_way_from_a_container_of_its_own(stack: Compose) -> None:
    own = ("run", "--rm", "-T")
    assert "healthy: plant of r1, robot of r1" in stack.tries(*own, "ground", "doctor").said
    refused = stack.tries(*own, "--no-deps", "ground", "fly")
    assert (refused.code, "unknown verb 'fly'" in refused.said) == (2, True), refused.said


def test_processes_in_containers_are_unprivileged(stack: Compose, part: str) -> None:
    def users() -> set[str]:
        return {who for words, who in stack.users(part).items() if "docker-init" not in words}

    # A health check of the robot begins as root, and goes on as the robot's user at once.
    expected = {ROBOTS_USER if part == "robot" else USER}
    until(
        lambda: users() == expected,
        within_s=SOON_S,
        what=lambda: f"{expected}; {users()}",
        poll_s=POLL_S,
    )
    limits = stack.inspected(part)["HostConfig"]
    assert limits["CapDrop"] == ["ALL"]
    added = {right.removeprefix("CAP_") for right in limits["CapAdd"] or ()}
    assert added == ({"KILL", "SETGID", "SETUID"} if part == "robot" else set())
    assert limits["PidsLimit"] == 256
    assert limits["Memory"] == 512 * MIB
    assert limits["NanoCpus"] == 10**9
    assert limits["SecurityOpt"] == ["no-new-privileges:true"]
    assert limits["ReadonlyRootfs"]
    assert limits["Init"]
    assert not limits["Privileged"]


def test_a_robot_keeps_no_right_that_its_container_began_with(stack: Compose) -> None:
    script = "import glob;print(*(open(p).read() for p in glob.glob('/proc/[0-9]*/status')))"
    told = stack.inside("robot", "python", "-c", script, user=ROBOTS_USER).said
    rights = [
        dict(line.split(":\t", 1) for line in status.splitlines() if ":\t" in line)
        for status in told.split("Name:")
        if "Uid:\t20001" in status
    ]
    assert rights
    for one in rights:
        assert {one[name] for name in ("CapInh", "CapPrm", "CapEff", "CapAmb")} == {"0" * 16}
        assert one["NoNewPrivs"] == "1"


def test_nothing_can_be_written_but_to_memory(stack: Compose, part: str) -> None:
    places = ("/", "/opt/sidestep", "/home/sidestep", "/etc/sidestep", "/keys")
    refused = stack.inside(part, "touch", *(f"{place}/x" for place in places), user=USER)
    assert refused.code == 1
    assert refused.said.count("Read-only file system") == len(places), refused.said
    assert stack.inside(part, "touch", "/tmp/x", user=USER).code == 0


def test_only_the_page_is_published_and_only_locally(stack: Compose) -> None:
    published = {part: stack.inspected(part)["HostConfig"]["PortBindings"] for part in PARTS}
    assert published.pop("web") == {"8765/tcp": [{"HostIp": "127.0.0.1", "HostPort": stack.port}]}
    assert not any(published.values())
    bus = json.loads(docker("network", "inspect", stack.network()))[0]
    assert (bus["Internal"], bus["Driver"]) == (True, "bridge")


def test_without_its_token_the_page_refuses(stack: Compose) -> None:
    there = stack.address.partition("?")[0]
    for path in ("/", "/?token=", "/?token=guessed"):
        answer = asked(there, path)
        assert (answer.status, "requires a token" in answer.text) == (403, True), answer


def test_with_its_token_the_page_is_there(stack: Compose) -> None:
    assert stack.address.startswith(f"http://127.0.0.1:{stack.port}/?token=")
    first = asked(stack.address, f"/?token={token_in(stack.address)}")
    assert first.status == 303
    page = asked(stack.address, "/", first.cookie)
    assert (page.status, "Sidestep" in page.text) == (200, True)


def test_the_token_is_in_the_log_and_nowhere_else(stack: Compose) -> None:
    token = token_in(stack.address)
    assert token not in json.dumps(stack.inspected("web"))
    assert token not in stack.inside("web", "env").said


@pytest.mark.skipif(chromium() is None, reason="no Chromium on this machine")
def test_the_browser_shows_the_robot(stack: Compose) -> None:
    async def story() -> bytes:
        async with browsing(stack.address) as page:
            png = await sees(page)
            assert not await page.value("document.body.classList.contains('-closed')"), "it ended"
            return png

    png = asyncio.run(story())
    keep(png, "compose.png")
    assert drawn(png) >= DRAWN


@pytest.mark.skipif(which("tmux") is None, reason="no tmux on this machine")
def test_the_ground_station_opens_in_a_terminal_and_leaves_it(
    stack: Compose, tmp_path: Path
) -> None:
    words = ["-C", str(ROOT), *stack.command("run", "--rm", "ground")]
    settings = {"SIDESTEP_IMAGE": stack.image, "PORT": stack.port}
    stack.arms()  # after a stop of a busy machine the app would not call it ready
    with Tmux(tmp_path, ["env", *words], (100, 30), settings) as terminal:
        terminal.shows("r1", "parameters read: ready", within_s=SOON_S)
        terminal.press("C-q")
        assert terminal.ends(SOON_S) == 0


def test_each_part_receives_only_what_it_needs(stack: Compose, part: str) -> None:
    found: dict[str, Any] = stack.inspected(part)["Config"]
    names = {entry.partition("=")[0] for entry in found["Env"]}
    own = {"PATH", "LANG", "PYTHONDONTWRITEBYTECODE", "PYTHONUNBUFFERED", "XDG_STATE_HOME"}
    of_the_base = {"PIP_CERT", "SSL_CERT_FILE", "GPG_KEY", "PYTHON_VERSION", "PYTHON_SHA256"}
    assert own <= names
    operators = {"SIDESTEP_PERSON"} if part == "web" else set()
    assert names <= own | of_the_base | operators


@pytest.fixture
def witness(wall: Compose) -> Iterator[Witness]:
    """Observe a robot that drives without an operator, so that only the fault stops it."""
    networks = wall.inspected("router")["NetworkSettings"]["Networks"]
    address = networks[wall.network()]["IPAddress"]
    with Witness(f"tcp/{address}:7447") as found:
        until(
            lambda: found.truths and found.statuses,
            within_s=SOON_S,
            what="messages of plant and robot",
        )
        set_off(found)
        yield found


def set_off(witness: Witness) -> None:
    """Armed, in AUTO, fast, to the place that is farther away: again and again, for a busy machine
    may stop it with a failsafe."""
    here = witness.truth
    x_m, y_m = max(PLACES, key=lambda place: hypot(place[0] - here.x_m, place[1] - here.y_m))
    goal = wire_goal(x_m, y_m, None, 0.1, 0.1)._asdict()

    def under_way() -> bool:
        if not drives(witness.status.vehicle) or witness.status.goal not in LIVING:
            number = monotonic_ns()
            for request in (
                *commands(number, witness),
                GoalRequest(request_id=number + 2, mode=Mode.AUTO, **goal),
            ):
                with suppress(NoAnswerError):
                    witness.bus.ask(COMMAND, request)
        return witness.truth.speed_m_s > FAST_M_S

    until(under_way, within_s=2 * SOON_S, what="driving")


def commands(number: int, witness: Witness) -> tuple[CommandRequest, CommandRequest]:
    """Return the true pose, which a robot that was restarted has lost, and the order to arm."""
    true = witness.truth
    return (
        CommandRequest(
            request_id=number,
            param1=true.x_m,
            param2=true.y_m,
            param3=true.heading_rad,
            command=Command.SIDESTEP_SET_POSE,
        ),
        CommandRequest(
            request_id=number + 1, param1=1.0, param2=0.0, command=Command.COMPONENT_ARM_DISARM
        ),
    )


def stood_in_time(witness: Witness) -> None:
    """Count, in the plant's time, from the last command to move to the first truth at rest."""
    until(witness.standing, within_s=SOON_S, what="standing")
    assert witness.rolled_on_ms() <= 200 + PERIOD_MS


def drives(vehicle: int) -> bool:
    return vehicle == Vehicle.ACTIVE


def stays(witness: Witness, *reasons: Reason) -> None:
    """Require that the robot stays stopped and gives the reason after the failed part is back."""
    told, heard = len(witness.statuses), len(witness.truths)
    until(
        lambda: len(witness.statuses) > told + 20 and len(witness.truths) > heard + 20,
        within_s=SOON_S,
    )
    assert not drives(witness.status.vehicle)
    assert witness.status.goal in (GoalState.ABORTED, GoalState.NONE)
    if reasons:
        assert Reason(witness.status.vehicle_reason) in reasons
    assert all(is_still(truth) for truth, _ in tuple(witness.truths)[-10:])


def test_a_robot_that_is_paused(wall: Compose, witness: Witness) -> None:
    docker("pause", wall.container("robot"))
    stood_in_time(witness)
    docker("unpause", wall.container("robot"))
    stays(witness, *LOST)


def test_a_robot_whose_network_is_cut(wall: Compose, witness: Witness) -> None:
    docker("network", "disconnect", wall.network(), wall.container("robot"))
    stood_in_time(witness)
    docker("network", "connect", "--alias", "robot", wall.network(), wall.container("robot"))
    stays(witness, *LOST)


def test_a_robot_that_is_killed(wall: Compose, witness: Witness) -> None:
    docker("kill", wall.container("robot"))
    stood_in_time(witness)
    docker("start", wall.container("robot"))
    stays(witness)
    assert witness.status.vehicle == Vehicle.STANDBY


def test_a_plant_whose_network_is_cut(wall: Compose, witness: Witness) -> None:
    docker("network", "disconnect", wall.network(), wall.container("plant"))
    until(lambda: witness.status.vehicle == Vehicle.FAILSAFE, within_s=SOON_S, what="FAILSAFE")
    assert Reason(witness.status.vehicle_reason) in LOST
    docker("network", "connect", "--alias", "plant", wall.network(), wall.container("plant"))
    stays(witness, *LOST)


def test_a_router_that_is_paused(wall: Compose, witness: Witness) -> None:
    docker("pause", wall.container("router"))
    until(
        lambda: monotonic_ns() - witness.truths[-1][1] > SILENCE_MS * MS,
        within_s=SOON_S,
        what="silence",
    )
    docker("unpause", wall.container("router"))
    until(
        lambda: not drives(witness.status.vehicle) and witness.standing(),
        within_s=SOON_S,
        what="standing",
    )
    stays(witness, *LOST)


def test_killed_robot_restarts_disarmed_and_reports_why(stack: Compose) -> None:
    restarts = restarts_of(stack, "robot")
    ready = stack.logs("robot").count("ready, disarmed")
    stack.arms()
    stack.inside("robot", *KILL_ALL)
    until(
        lambda: stack.logs("robot").count("ready, disarmed") > ready,
        within_s=SOON_S,
        what="another robot",
        poll_s=POLL_S,
    )
    assert "restarted: the previous run" in stack.logs("robot")
    stack.recovers()
    seen = stack.verb("watch", "--json").object
    assert seen["streams"]["tlm/status"]["message"]["vehicle"] == Vehicle.STANDBY
    assert restarts_of(stack, "robot") == restarts + 1


def test_a_router_that_was_killed_comes_back_and_all_find_each_other_again(stack: Compose) -> None:
    restarts = restarts_of(stack, "router")
    stack.inside("router", *KILL_ALL)
    until(
        lambda: restarts_of(stack, "router") == restarts + 1,
        within_s=SOON_S,
        what="another router",
        poll_s=POLL_S,
    )
    until(
        lambda: stack.verb("doctor").code == 0,
        within_s=2 * SOON_S,
        what="all find each other",
        poll_s=POLL_S,
    )


def restarts_of(stack: Compose, part: str) -> int:
    return int(stack.inspected(part)["RestartCount"])


def test_stop_ends_all_containers_normally(
    stack: Compose, capsys: pytest.CaptureFixture[str]
) -> None:
    with stack.running("logs", "--follow", "--since", "1s") as following:
        began_s = monotonic()
        stack.does("stop", "--timeout", str(int(SOON_S)))  # a busy machine needs longer than 4 s
        took_s = monotonic() - began_s
        said, _ = following.communicate(timeout=SOON_S)
    with capsys.disabled():
        print(f"\nall containers ended in {took_s:.1f} s")
    codes = {part: stack.inspected(part)["State"]["ExitCode"] for part in PARTS}
    assert codes == dict.fromkeys(PARTS, 0)
    for last in ("router ends", "plant: ends", "robot r1: ends", "ground station ends"):
        assert last in said.decode(), said.decode()


@pytest.fixture(scope="module")
def refusing(image: str) -> Iterator[Compose]:
    """Provide one project for all wrong settings: nothing of it stays up."""
    with project(image) as compose:
        yield compose


@pytest.mark.parametrize(
    ("settings", "part", "words"),
    [
        ({"WORLD": "atlantis"}, "robot", "atlantis"),
        ({"ROBOTS": "0"}, "plant", "--robots: 0 is not within 1 to 20"),
        ({"NOISE": "loud"}, "plant", "--noise: invalid choice: 'loud'"),
    ],
)
def test_a_setting_that_cannot_be_is_named(
    refusing: Compose, settings: dict[str, str], part: str, words: str
) -> None:
    refusing.settings = settings
    # Under the name that `up` gives, by which a robot finds its number.
    named = ("--name", refusing.container(part))
    done = refusing.tries("run", "--rm", "-T", "--no-deps", *named, part)
    assert (done.code, words in done.said) == (2, True), done.said
    assert "Traceback" not in done.said


def test_number_of_robots_is_that_of_their_drives_and_recorders(refusing: Compose) -> None:
    refusing.settings = {"ROBOTS": "3"}
    found = refusing.tries("--profile", "*", "config", "--format", "json")
    assert found.code == 0, found.said
    services = json.loads(found.said)["services"]
    counts = {name: one["deploy"]["replicas"] for name, one in services.items() if "deploy" in one}
    assert counts == {"robot": 3, "drive": 3, "record": 3}
    for name in ("plant", "mavlink"):
        assert "--robots=3" in services[name]["entrypoint"]


def test_a_port_that_is_taken_is_named(refusing: Compose) -> None:
    with closing(socket.socket()) as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        refusing.settings = {"PORT": port}
        done = refusing.tries("up", "-d", "--no-build", "--no-deps", "web")
    assert done.code != 0
    assert port in done.said
    assert "in use" in done.said or "allocated" in done.said


MOST_MB: Final = 300
SECRETS: Final = re.compile(r"-----BEGIN|token=|password|index-url|index_url|://[^ ]*@", re.I)
MISSING: Final = """
from importlib.metadata import distributions, requires, version
import re
for distribution in distributions():
    for wanted in distribution.requires or ():
        if "extra ==" not in wanted and "python_version" not in wanted:
            version(re.match(r"[A-Za-z0-9._-]+", wanted)[0])
print("complete")
"""
UNCOMPILED: Final = """
from pathlib import Path
import sys
places = [Path(path) for path in sys.path if path.startswith("/opt")]
modules = [file for place in places for file in place.rglob("*.py")]
bare = [file for file in modules
        if not list((file.parent / "__pycache__").glob(file.stem + ".cpython-*.pyc"))]
print(len(modules), *bare)
"""


def within(image: str, *words: str) -> Done:
    """Run a program of the image without network and privileges."""
    alone = ("--rm", "--read-only", "--network=none", "--cap-drop=ALL", "--entrypoint", words[0])
    return tried(
        ["docker", "run", *alone, image, *words[1:]], {"PATH": "/usr/local/bin:/usr/bin"}, 60
    )


def python(image: str, script: str) -> str:
    done = within(image, "python", "-c", script)
    assert done.code == 0, done.said
    return done.said


def test_it_is_small(image: str) -> None:
    size_mb = json.loads(docker("image", "inspect", image))[0]["Size"] / 1e6
    assert size_mb < MOST_MB, f"{size_mb:.0f} MB"


def test_image_runs_as_an_unprivileged_user(image: str) -> None:
    assert within(image, "id", "-u").said.strip() == "10001"
    assert within(image, "sidestep", "--version").said.startswith("sidestep 0.")


def test_all_that_its_packages_want_is_there(image: str) -> None:
    assert python(image, MISSING).strip() == "complete"


def test_what_only_makes_and_tests_it_is_not(image: str) -> None:
    modules = ("sidestep", "pip", "pytest", "mypy", "hatchling")
    script = f"from importlib.util import find_spec; print(*filter(find_spec, {modules}))"
    assert python(image, script).strip() == "sidestep"


def test_its_modules_are_compiled(image: str) -> None:
    modules, *bare = python(image, UNCOMPILED).split()
    assert int(modules) > 1000
    assert bare == []


def test_no_secret_is_in_its_history_or_its_settings(image: str) -> None:
    history = docker("history", "--no-trunc", "--format", "{{.CreatedBy}}", image)
    assert "COPY" in history
    assert not SECRETS.search(history)
    assert not SECRETS.search(docker("image", "inspect", image))


def test_no_key_is_in_its_files(image: str) -> None:
    places = ("/opt/sidestep", "/etc/sidestep", "/home", "/keys", "/state", "/root", "/run")
    sought = ("(", "-name", "*.key", "-o", "-name", "*.pem", "-o", "-name", "pip.conf", ")")
    done = within(image, "find", *places, *sought, "-type", "f")
    assert [line for line in done.said.splitlines() if line.startswith("/")] == []


@pytest.fixture(scope="module")
def checkout(image: str) -> Iterator[Compose]:
    """Build the image with the tree and the tools."""
    with project(images.image("tests")) as compose:
        yield compose


def test_measurements_run_in_the_image_with_the_tree(checkout: Compose) -> None:
    done = checkout.tries("run", "--rm", "-T", "bench", "codec")
    assert done.code == 0, done.said


def test_the_tests_run_in_the_image_with_the_tree(checkout: Compose) -> None:
    modules = ("tests/bus/test_refusals.py", "tests/stack/test_operator.py")
    chosen = ("-k", "valid_certificate or poor and environment0")
    done = checkout.tries("run", "--rm", "-T", "tests", "-q", *modules, *chosen)
    assert (done.code, "2 passed" in done.said) == (0, True), done.said
