"""No text pasted in a browser ends the app; the test uses the protocol of its web server."""

import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from tests.support.stack.processes import Crew
from tests.support.until import PATIENCE_S, until

pytestmark = pytest.mark.stack

SIDESTEP = Path(__file__).parents[3] / "sidestep.py"
DRIVER = "textual.drivers.web_driver:WebDriver"
READY = b"__GANGLION__\n"
LEAVE = "\x11"
HOSTILE = (
    "\x1b[200~\x1b[48;;;;t\x1b[201~",
    "\x1b[99999999999u",
    "\x1b[200~ D D a",
)


def packet(text: str) -> bytes:
    data = text.encode()
    return b"D" + len(data).to_bytes(4, "big") + data


@pytest.mark.parametrize("text", HOSTILE)
def test_after_any_paste_keys_still_count(tmp_path: Path, text: str) -> None:
    with Crew() as crew:
        crew.robot()
        words = [sys.executable, str(SIDESTEP), "ground", "--connect", crew.endpoint, "--no-record"]
        environment = {**os.environ, "TEXTUAL_DRIVER": DRIVER, "XDG_STATE_HOME": str(tmp_path)}
        drawn = tmp_path / "drawn"
        with (
            drawn.open("wb") as output,
            subprocess.Popen(
                words, env=environment, stdin=subprocess.PIPE, stdout=output, cwd=tmp_path
            ) as app,
        ):
            try:
                until(lambda: READY in drawn.read_bytes(), what="the app")
                send(app, text)
                assert leaves(app) == 0
            finally:
                app.kill()


def send(app: "subprocess.Popen[bytes]", text: str) -> None:
    assert app.stdin is not None
    app.stdin.write(packet(text))
    app.stdin.flush()


def leaves(app: "subprocess.Popen[bytes]") -> int:
    """Press the key that leaves, until it does."""
    for _ in range(round(PATIENCE_S / 0.5)):
        try:
            with suppress(BrokenPipeError):  # it has just left
                send(app, LEAVE)
            return app.wait(0.5)
        except subprocess.TimeoutExpired:
            continue
    raise AssertionError("no key counts any more")
