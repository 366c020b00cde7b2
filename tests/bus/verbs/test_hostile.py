"""Texts from a hostile robot hold terminal control sequences: no verb prints any of them."""

import json
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from subprocess import PIPE, STDOUT

import pytest
import zenoh

import sidestep
from checks.harness.terminal import Terminal
from protocol.bus.services import ServiceRequest
from protocol.topics import DECISION, LEASE, TEXT, WORLD
from protocol.wire.enums import Severity
from protocol.wire.messages import Statustext
from protocol.wire.statustext import pieces_of
from tests.support.bus.robots import PlayedRobot, played
from tests.support.hostile import OWNED, raw_in
from tests.support.hostile import TEXT as HOSTILE
from tests.support.until import PATIENCE_S

ROOT = Path(__file__).parents[3]
PARAMETERS = [
    {"name": "d_obs_m", "value": 0.4, "default": 0.3, "unit": HOSTILE, "minimum": 0.05,
     "maximum": 3.0, "doc": f"zone {HOSTILE}\n[network]\nconnect = [1]"},
]  # fmt: skip
SHOWS = ("doctor --timeout 0.4", "param list", "lease show", "lease take", "doctor --json")
"""Lines whose output has the text in it, so that a verb that fails early does not pass."""


class Hostile:
    """Publishes ten times a second, until it is closed, what only a raw session can."""

    def __init__(self, robot: PlayedRobot, endpoint: str) -> None:
        robot.desk.held = ("beef", f"\x1b]0;{OWNED}\x07\x7f")
        robot._list = self._list  # type: ignore[method-assign]
        robot.bus.serve(WORLD, self._world)
        self._texts = robot.bus.publisher(TEXT)
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        self._session = zenoh.open(config)
        self._tokens = [
            self._session.liveliness().declare_token(f"sidestep/{name}/alive/robot/4f2a")
            for name in (f"r{HOSTILE}", f"r{OWNED}")
        ]
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._speak, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._ends.set()
        self._thread.join()
        self._session.close()  # type: ignore[no-untyped-call]

    def _speak(self) -> None:
        while not self._ends.wait(0.1):
            self._texts.put(Statustext(severity=3, text=HOSTILE, id=0, chunk_seq=0))
            for piece in pieces_of(f"long {HOSTILE}" * 5, 7, Severity.ERROR):
                self._texts.put(piece)
            for topic in (DECISION, LEASE):
                self._session.put(topic.key("r1"), b"x", encoding=HOSTILE)

    def _list(self, asked: ServiceRequest) -> None:
        asked.reply(json.dumps(PARAMETERS).encode())

    def _world(self, asked: ServiceRequest) -> None:
        asked.reply(json.dumps({"name": HOSTILE, "size_m": HOSTILE}).encode())


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    with played() as (robot, where):
        hostile = Hostile(robot, where)
        yield where
        hostile.close()


Run = Callable[..., str]


@pytest.fixture
def run(
    endpoint: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> Run:  # fmt: skip
    """Everything that a verb writes, to both outputs."""
    monkeypatch.chdir(tmp_path)

    def said(*words: str) -> str:
        sidestep.main([*words, "--connect", endpoint])
        found = capsys.readouterr()
        return found.out + found.err

    return said


@pytest.mark.parametrize(
    "line",
    [
        *SHOWS, "watch --once", "watch --once --json", "doctor --id nobody --timeout 0.1",
        "param list --json", "param diff", "param set d_obs_m 9", "param get nothing",
        "goto 1 1 --timeout 0.5", "mission status", "fence show", "mode hold", "explain", "ghost",
    ],
)  # fmt: skip
def test_a_verb_lets_no_control_character_out(line: str, run: Run) -> None:
    said = run(*line.split())
    assert said
    assert raw_in(said) == []
    assert OWNED in said or line not in SHOWS


@pytest.mark.parametrize("line", ["watch", "ground --plain --no-record"])
def test_what_is_shown_live_lets_none_out_and_stays_in_its_line(line: str, endpoint: str) -> None:
    command = [sys.executable, "-m", "sidestep", *line.split(), "--connect", endpoint]
    with subprocess.Popen(command, cwd=ROOT, stdout=PIPE, stderr=STDOUT, text=True) as process:
        deadline = threading.Timer(PATIENCE_S, process.kill)
        deadline.start()
        assert process.stdout is not None
        said = []
        for one in process.stdout:
            said.append(one)
            if f"long ?]0;{OWNED}?" in one:
                process.send_signal(signal.SIGINT)  # once for each line that was still written
        deadline.cancel()
    assert process.returncode == 128 + signal.SIGINT
    assert raw_in("".join(said)) == []
    assert all(one.startswith("r1: ") for one in said if OWNED in one)


def test_a_saved_list_sets_parameters_only(run: Run) -> None:
    run("param", "save", "p.toml")
    text = Path("p.toml").read_text(encoding="utf-8")
    assert text.splitlines()[0] == "[parameters]"
    assert [line.split(" = ")[0] for line in text.splitlines()[1:]] == ["d_obs_m"]


def test_token_without_a_valid_robot_name_is_ignored(run: Run) -> None:
    said = run("watch", "--once", "--id", "nobody")
    assert "only r1: use --id" in said
    assert OWNED not in said


def test_the_app_on_a_terminal_lets_none_out(endpoint: str, tmp_path: Path) -> None:
    """Check each byte the app writes: only Textual's own sequences are allowed."""
    words = ("ground", "--connect", endpoint, "--no-record")
    with Terminal(words, (120, 40), {"XDG_STATE_HOME": str(tmp_path)}) as terminal:
        for key, sign in (("", "long"), ("4", "long"), ("3", "zone"), ("5", "is encoded as")):
            terminal.forget()
            terminal.type(key)
            terminal.shown(sign, PATIENCE_S)
            terminal.shown(OWNED, PATIENCE_S)
            shown = terminal.text()
            assert f"\x1b]0;{OWNED}" not in shown
            assert "\x9b" not in shown
            assert "\u202e" not in shown
            assert "\x7f" not in shown
