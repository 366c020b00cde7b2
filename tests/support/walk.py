"""Follow README and tutorial in a new container: `python -m tests.support.walk [OPTION ...]`.

The options are for `docker run`. Each command runs as the page writes it, from the installation on,
in a clone of the last commit. The container is a Debian with git and a user who may use sudo. Print
the time of each page, and each command whose exit code or output differs from its page.
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from tests.support.pages import PATIENCE_S, ROOT, Command, File, Step, matches, steps_of

IMAGE: Final = "python:3.13-slim-trixie"
PAGES: Final = (
    "docs/tutorial/index.md",
    "README.md",
    "docs/tutorial/first-drive.md",
    "docs/tutorial/mission.md",
    "docs/tutorial/recording.md",
    "docs/tutorial/own-world.md",
)
MACHINE: Final = """apt-get -qq update && apt-get -qq install -y git sudo && useradd -m newcomer
echo 'newcomer ALL=(ALL) NOPASSWD: ALL' >/etc/sudoers.d/newcomer"""
SCREEN: Final = (
    "(sleep 15; printf '\\021'; sleep 1; printf '\\021') | script -qec '{}' /dev/null >/dev/null"
)
"""Run a command in a terminal, and press ctrl+q twice after 15 s: a robot may drive."""
BACKGROUND: Final = "echo $$ >>/tmp/pids; exec {} >/tmp/{}.log 2>&1"
END: Final = "test ! -e /tmp/pids || (kill -INT $(cat /tmp/pids); rm /tmp/pids)"


class Newcomer:
    """Follows pages in terminals of a container."""

    def __init__(self, container: str) -> None:
        self._container = container
        self._in_each_terminal = "cd ~/sidestep"

    def type(self, words: str, *options: str, text: str = "y\n") -> tuple[int, list[str]]:
        """Run a command in a new terminal. Return its exit code and its output."""
        line = ("bash", "-c", f"{self._in_each_terminal} && {words}")
        return run(
            "docker", "exec", "-i", *options, "-u", "newcomer", self._container, *line, text=text
        )

    def follow(self, step: Step) -> str:
        """Do what a step asks for. Return how the result differs from the page, or nothing."""
        if isinstance(step, File):
            self.type(f"cat >{step.name}", text=step.text)
        if not isinstance(step, Command):
            return ""
        words, deadline_s = step.words, time.monotonic()
        if words.startswith("export "):
            self._in_each_terminal += f" && {words}"
        if step.runner is not None and words.startswith("sidestep "):
            words = SCREEN.format(words)
        if step.directive == "background":
            self.type(BACKGROUND.format(words, step.line), "-d")
            words = f"cat /tmp/{step.line}.log"
        if step.directive in ("background", "until"):
            deadline_s += PATIENCE_S
        while True:
            code, printed = self.type(words)
            is_same = step.runner is not None or matches(step.output, printed)
            if code == step.exit_code and is_same:
                return ""
            if time.monotonic() >= deadline_s:
                return "\n".join((f"{step.line}: {step.words}: exit {code}", *printed))


def run(*words: str, text: str = "") -> tuple[int, list[str]]:
    """Run a command with `text` as its input. Return its exit code and its output."""
    pipe, both = subprocess.PIPE, subprocess.STDOUT
    done = subprocess.run(words, input=text, stdout=pipe, stderr=both, text=True, check=False)
    return done.returncode, done.stdout.splitlines()


def main(options: Sequence[str]) -> int:
    """Follow all pages; 1 when a command differs from its page."""
    differences = 0
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)  # another user reads it
        run("git", "-C", str(ROOT), "bundle", "create", f"{folder}/checkout", "HEAD")
        mount = ("-v", f"{folder}:/walk:ro", *options, IMAGE, "sleep", "infinity")
        code, (*_, container) = run("docker", "run", "--rm", "-d", "--init", *mount)
        assert code == 0, container
        try:
            for user, words in (
                ("root", MACHINE),
                ("newcomer", "git clone -q /walk/checkout ~/sidestep"),
            ):
                code, printed = run("docker", "exec", "-u", user, container, "bash", "-c", words)
                assert code == 0, printed
            newcomer, began_s = Newcomer(container), time.monotonic()
            for page in PAGES:
                page_began_s = time.monotonic()
                steps = steps_of(ROOT / page)
                for found in filter(None, map(newcomer.follow, steps)):
                    print(f"{page}:{found}", flush=True)
                    differences += 1
                newcomer.type(END)
                count = sum(isinstance(step, Command) for step in steps)
                print(
                    f"{page}: {count} commands, {time.monotonic() - page_began_s:.0f} s", flush=True
                )
            print(f"all: {time.monotonic() - began_s:.0f} s, {differences} differences")
        finally:
            run("docker", "rm", "-f", container)
    return int(differences > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
