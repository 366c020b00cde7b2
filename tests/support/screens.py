"""What people look at: a terminal in tmux, and a headless Chromium by its own protocol."""

import asyncio
import base64
import io
import json
import os
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

from checks.harness.until import PATIENCE_S, until

NAMES = {" ": "Space", ";": "\\;"}
POLL_S = 0.05
"""A look at the screen starts a process."""


class Tmux:
    """A server of its own with one window, in which a command runs; the window outlives it."""

    def __init__(
        self,
        folder: Path,
        words: Sequence[str],
        size: tuple[int, int] = (80, 24),
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self._socket = folder / "tmux"
        self._folder, self._size = folder, size
        own = dict.fromkeys(("XDG_STATE_HOME", "XDG_CONFIG_HOME"), str(folder))
        settings = {**own, **(environment or {})}
        set_words = [f"{name}={value}" for name, value in settings.items()]
        self._ended = folder / "ended"
        command = shlex.join(["env", *set_words, *words])
        self._command = f"{command}; echo $? >{shlex.quote(str(self._ended))}"

    def __enter__(self) -> Self:
        columns, rows = map(str, self._size)
        settings = ("remain-on-exit on", "default-terminal tmux-256color", "status off")
        first = [word for line in settings for word in ("set", "-g", *line.split(), ";")]
        session = ("new-session", "-d", "-x", columns, "-y", rows, "-c", str(self._folder))
        self._tmux("-f", "/dev/null", "start-server", ";", *first, *session, self._command)
        return self

    def __exit__(self, *_: object) -> None:
        self._tmux("kill-server", check=False)

    @property
    def screen(self) -> str:
        return self._tmux("capture-pane", "-p")

    @property
    def coloured(self) -> str:
        """The same with the colours that it is in."""
        return self._tmux("capture-pane", "-p", "-e")

    def shows(self, *words: str, within_s: float = PATIENCE_S) -> str:
        """Wait for a screen with all of these words; return it."""
        found = ""

        def there() -> bool:
            nonlocal found
            found = self.screen
            return all(word in found for word in words)

        try:
            until(there, within_s=within_s, what=f"{words} on the screen", poll_s=POLL_S)
        except RuntimeError as error:
            raise AssertionError(f"{error}\n{found}") from None
        return found

    def press(self, *keys: str) -> None:
        """Keys by tmux's names: `h`, `Enter`, `F12`, `C-q`."""
        self._tmux("send-keys", *(NAMES.get(key, key) for key in keys))

    def type(self, text: str) -> None:
        """Letter by letter, as if it were typed."""
        self._tmux("send-keys", "-l", text)

    def send_bytes(self, data: bytes) -> None:
        """Send bytes as they are."""
        self._tmux("send-keys", "-H", *(f"{byte:02x}" for byte in data))

    def paste(self, text: str) -> None:
        """Paste text at once with the brackets of bracketed paste."""
        self._tmux("load-buffer", "-", stdin=text)
        self._tmux("paste-buffer", "-p", "-r")

    def resize(self, columns: int, rows: int) -> None:
        self._tmux("resize-window", "-x", str(columns), "-y", str(rows))

    @property
    def exit_code(self) -> int | None:
        """Return the exit code; None while the command runs."""
        text = self._ended.read_text() if self._ended.exists() else ""
        return int(text) if text.endswith("\n") else None

    def ends(self, within_s: float = PATIENCE_S) -> int:
        until(
            lambda: self.exit_code is not None,
            within_s=within_s,
            what=f"the end; screen:\n{self.screen}",
        )
        code = self.exit_code
        assert code is not None
        return code

    def _tmux(self, *words: str, stdin: str | None = None, check: bool = True) -> str:
        done = subprocess.run(
            ["tmux", "-S", str(self._socket), *words],
            input=stdin,
            capture_output=True,
            text=True,
            check=check,
        )
        return done.stdout


if TYPE_CHECKING:
    import aiohttp

CHROMIUMS: Final = ("chromium", "chromium-browser", "google-chrome")
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
    return next((found for name in CHROMIUMS if (found := shutil.which(name))), None)


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
