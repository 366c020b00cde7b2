"""A terminal that people use: tmux, with what it shows as text and keys as their names."""

import shlex
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Self

from tests.support.until import PATIENCE_S, until

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
            until(there, within_s, f"{words} on the screen", POLL_S)
        except AssertionError as error:
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
        until(lambda: self.exit_code is not None, within_s, f"the end; screen:\n{self.screen}")
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
