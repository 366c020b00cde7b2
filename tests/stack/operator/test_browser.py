"""The ground station in a browser: a headless Chromium sees the map, and what it types drives."""

import asyncio
import re
import signal
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from math import hypot
from pathlib import Path

import pytest

from tests.support.stack.browser import SEEN_S, Page, browsing, chromium, keep, sees
from tests.support.stack.processes import Crew, Running, Witness, free_endpoint
from tests.support.until import until

pytestmark = [
    pytest.mark.stack,
    pytest.mark.skipif(chromium() is None, reason="no Chromium on this machine"),
]


@contextmanager
def served(crew: Crew) -> Iterator[tuple[Running, str]]:
    """Start the ground station for browsers; return it with the address that it prints."""
    port = free_endpoint().rpartition(":")[2]
    ground = crew.dialling("ground", "--web", port)
    ground.says("open http", 20.0)
    found = re.search(r"open (http://\S+)", ground.said)
    assert found is not None
    yield ground, found[1]


def in_browser(url: str, story: Callable[[Page], Awaitable[None]]) -> None:
    async def tell() -> None:
        async with browsing(url) as page:
            await story(page)

    asyncio.run(tell())


def test_the_map_draws_and_a_goal_that_is_typed_there_moves_the_robot() -> None:
    with Crew(lockstep=True) as crew:
        crew.robot()
        crew.plant()
        with served(crew) as (_, url), Witness(crew.endpoint) as witness:
            witness.ready()
            start = witness.truth

            async def story(page: Page) -> None:
                keep(await sees(page), "browser-standing.png")
                assert "token" not in await page.value("location.href")
                await page.click(600, 5)
                async with asyncio.timeout(SEEN_S):
                    while witness.truth.speed_m_s < 0.25:  # refused until all has been read
                        await page.type(":goal 2.6 2.0\n")
                        await asyncio.sleep(1.0)
                keep(await sees(page), "browser-driving.png")

            in_browser(url, story)
            assert hypot(witness.truth.x_m - start.x_m, witness.truth.y_m - start.y_m) > 0.1
            # The browser is gone and with it the operator: the robot does not go on.
            until(witness.standing, what="standing without an operator")


def test_without_the_token_a_browser_sees_a_refusal_and_nothing_is_started() -> None:
    with Crew() as crew, served(crew) as (_, url):

        async def story(page: Page) -> None:
            async with asyncio.timeout(SEEN_S):
                while "requires a token" not in (await page.value("document.body.innerText") or ""):
                    await asyncio.sleep(0.1)

        in_browser(url.partition("?")[0], story)


def test_ctrl_c_ends_the_server_and_the_apps_of_its_browsers() -> None:
    with Crew() as crew:
        crew.robot()
        crew.plant()
        with served(crew) as (ground, url):

            async def story(page: Page) -> None:
                await sees(page)
                children = children_of(ground.process.pid)
                assert len(children) == 1
                ground.send(signal.SIGINT)
                assert await asyncio.to_thread(ground.ends) in (0, 128 + signal.SIGINT)
                await asyncio.to_thread(until, lambda: not Path(f"/proc/{children[0]}").exists())

            in_browser(url, story)
            assert "Traceback" not in ground.said


def test_a_port_that_is_taken_and_a_place_that_is_none_are_refused() -> None:
    with Crew() as crew, served(crew) as (_, url):
        port = url.partition("?")[0].strip("/").rpartition(":")[2]
        code, said = crew.run("ground", "--web", port)
        assert (code, "choose another port" in said) == (2, True), said
        code, said = crew.run("ground", "--web", "127.0.0.1:99999")
        assert (code, "1 to 65535" in said) == (2, True), said


def children_of(pid: int) -> list[int]:
    return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
