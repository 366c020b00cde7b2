"""`docker compose up`: a robot that drives, seen in a browser, with few rights."""

import asyncio
import json
from pathlib import Path
from shutil import which
from typing import Any

import pytest

from tests.support.compose.compose import ROOT, Compose, docker
from tests.support.compose.web import asked, token_in
from tests.support.stack.browser import DRAWN, browsing, chromium, drawn, keep, sees
from tests.support.stack.tmux import Tmux

pytestmark = pytest.mark.compose

PARTS = ("router", "plant", "robot", "web")
USER = "10001"
ROBOTS_USER = "20001"
MIB = 1 << 20


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
    assert "healthy: plant of r1, robot of r1" in stack.verb("doctor").said
    assert "u_trap" in stack.verb("worlds", "list").said
    refused = stack.verb("fly")
    assert (refused.code, "unknown verb 'fly'" in refused.said) == (2, True), refused.said


def test_processes_in_containers_are_unprivileged(stack: Compose, part: str) -> None:
    users = {who for words, who in stack.users(part).items() if "docker-init" not in words}
    assert users == {ROBOTS_USER if part == "robot" else USER}
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
    for place in ("/", "/opt/sidestep", "/home/sidestep", "/etc/sidestep", "/keys"):
        done = stack.inside(part, "touch", f"{place}/x", user=USER)
        assert (done.code, "Read-only file system" in done.said) == (1, True), done.said
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
        terminal.shows("r1", "parameters read: ready", within_s=60.0)
        terminal.press("C-q")
        assert terminal.ends(30.0) == 0


def test_each_part_receives_only_what_it_needs(stack: Compose, part: str) -> None:
    found: dict[str, Any] = stack.inspected(part)["Config"]
    names = {entry.partition("=")[0] for entry in found["Env"]}
    own = {"PATH", "LANG", "PYTHONDONTWRITEBYTECODE", "PYTHONUNBUFFERED", "XDG_STATE_HOME"}
    of_the_base = {"PIP_CERT", "SSL_CERT_FILE", "GPG_KEY", "PYTHON_VERSION", "PYTHON_SHA256"}
    assert own <= names
    assert names <= own | of_the_base
