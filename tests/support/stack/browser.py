"""A headless Chromium, controlled by its own protocol: open a page, type, take a picture."""

import asyncio
import base64
import io
import json
import os
import shutil
import tempfile
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    import aiohttp

NAMES: Final = ("chromium", "chromium-browser", "google-chrome")
FLAGS: Final = (
    *("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"),
    *("--no-first-run", "--disable-extensions", "--remote-debugging-port=0", "--mute-audio"),
    "--window-size=1200,700",
)
START_S: Final = 30.0
SEEN_S = 60.0
DRAWN = 20_000
"""Pixels that are not the background: the map, the numbers and the log are far more."""


def chromium() -> str | None:
    """Return the path of Chromium; None when this machine has none."""
    return next((found for name in NAMES if (found := shutil.which(name))), None)


class Page:
    """One tab."""

    def __init__(self, socket: "aiohttp.ClientWebSocketResponse") -> None:
        self._socket = socket
        self._asked = 0

    async def do(self, method: str, **parameters: object) -> dict[str, Any]:
        """Ask the browser; its answer, or an AssertionError with its words."""
        self._asked += 1
        await self._socket.send_json({"id": self._asked, "method": method, "params": parameters})
        while True:
            said: dict[str, Any] = json.loads(await self._socket.receive_str(timeout=START_S))
            if said.get("id") == self._asked:
                assert "error" not in said, said["error"]
                answer: dict[str, Any] = said["result"]
                return answer

    async def value(self, script: str) -> Any:
        """Evaluate JavaScript; return its value, or an AssertionError with what it has thrown."""
        answer = await self.do("Runtime.evaluate", expression=script, returnByValue=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    async def click(self, x: int, y: int) -> None:
        """Click with the left button; typed text goes there."""
        for what in ("mousePressed", "mouseReleased"):
            place = {"x": x, "y": y, "button": "left", "clickCount": 1}
            await self.do("Input.dispatchMouseEvent", type=what, **place)

    async def type(self, text: str) -> None:
        """Press a key for each letter; a new line is Enter."""
        for letter in text:
            key = {"key": "Enter", "code": "Enter", "windowsVirtualKeyCode": 13, "text": "\r"}
            if letter != "\n":
                key = {"key": letter, "text": letter}
            await self.do("Input.dispatchKeyEvent", type="keyDown", **key)
            await self.do("Input.dispatchKeyEvent", type="keyUp", key=key["key"])

    async def picture(self) -> bytes:
        """Return a PNG of the visible page."""
        answer = await self.do("Page.captureScreenshot", format="png")
        return base64.b64decode(answer["data"])


@asynccontextmanager
async def browsing(url: str) -> AsyncIterator[Page]:
    """Open the page in a browser; end the browser afterwards."""
    import aiohttp  # not when tests are collected

    program = chromium()
    assert program is not None
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        process = await asyncio.create_subprocess_exec(
            program,
            *FLAGS,
            f"--user-data-dir={profile}",
            url,
            stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.DEVNULL,
        )
        try:
            async with aiohttp.ClientSession() as session:
                target = await _target(session, Path(profile) / "DevToolsActivePort")
                async with session.ws_connect(target, max_msg_size=0) as socket:
                    page = Page(socket)
                    await _loaded(page)
                    yield page
        finally:
            process.kill()
            await process.wait()


async def _target(session: "aiohttp.ClientSession", file: Path) -> str:
    """Return the address for control of the only tab."""
    async with asyncio.timeout(START_S):
        while True:
            if file.exists() and (lines := file.read_text().splitlines()):
                async with session.get(f"http://127.0.0.1:{lines[0]}/json/list") as answer:
                    for tab in await answer.json():
                        if tab["type"] == "page":
                            return str(tab["webSocketDebuggerUrl"])
            await asyncio.sleep(0.05)


async def _loaded(page: Page) -> None:
    """Wait until the page has taken the place of the empty one that a tab begins with."""
    script = "location.protocol !== 'about:' && document.readyState === 'complete'"
    async with asyncio.timeout(START_S):
        while not await page.value(script):
            await asyncio.sleep(0.05)


def drawn(png: bytes) -> int:
    """Return how many pixels differ from the most frequent colour."""
    import numpy as np
    from PIL import Image

    pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).reshape(-1, 3).astype(int)
    codes = pixels[:, 0] * 65536 + pixels[:, 1] * 256 + pixels[:, 2]
    _, counts = np.unique(codes, return_counts=True)
    return int(counts.sum() - counts.max())


async def sees(page: Page) -> bytes:
    """Return the first picture that shows the app and not only its splash screen."""
    async with asyncio.timeout(SEEN_S):
        while not await page.value("document.body.classList.contains('-first-byte')"):
            await asyncio.sleep(0.1)
        while drawn(png := await page.picture()) < DRAWN:
            await asyncio.sleep(0.2)
    return png


def keep(png: bytes, name: str) -> None:
    """Keep a picture for inspection, if a folder for that is set."""
    folder = os.environ.get("SIDESTEP_PICTURES")
    if folder:
        Path(folder, name).write_bytes(png)
