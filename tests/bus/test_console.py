"""The app's console sends the requests of the command line; hostile texts are not printed."""

import asyncio
import json
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from io import StringIO
from pathlib import Path
from subprocess import PIPE, STDOUT
from typing import Any

import msgspec
import pytest
import zenoh

from checks.harness.terminal import Terminal
from checks.harness.until import PATIENCE_S
from ground.cli import main as cli
from ground.cli.options import common_of
from ground.client.connection import Common
from ground.client.leases import Leasing
from ground.commands.mission import OfMissionFile
from ground.console.parser import read
from ground.missions.files import Draft
from ground.missions.mission import Waypoint
from ground.robot import Robot
from protocol.bus.bus import Bus, open_bus
from protocol.bus.mailbox import Mailbox
from protocol.bus.services import ServiceRequest
from protocol.topics import DECISION, LEASE, TEXT, WORLD, Role
from protocol.wire.enums import LeaseAction, Mode, Severity, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import CommandRequest, GoalRequest, Statustext
from protocol.wire.reasons import Reason
from protocol.wire.statustext import pieces_of
from runtime.errors import RemoteError, UserError
from sidestep.__main__ import main
from tests.support.ground.client import Notes
from tests.support.ground.spoken import SPOKEN
from tests.support.hostile import OWNED, raw_in
from tests.support.hostile import TEXT as HOSTILE
from tests.support.played_robot import PlayedRobot, played

ROOT = Path(__file__).parents[2]
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
        main([*words, "--connect", endpoint])
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
    assert "only r1: name one that is there, as in --id r1" in said
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


OF_RECORDINGS = ("explain", "ghost", "mark", "plot")
ENDLESS = ("watch", "ground")
TALKING = [(typed, argv) for typed, argv in SPOKEN if argv[0] not in OF_RECORDINGS + ENDLESS]
MISSION = "[[waypoint]]\nx_m = 1.5\ny_m = 2\n"


@pytest.fixture
def _files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "stdin", StringIO(MISSION))
    (tmp_path / "m.toml").write_text(MISSION)
    (tmp_path / "q.toml").write_text("[parameters]\nd_obs_m = 0.6\n")
    home = ("--home", "47.4", "8.5")
    assert cli.main(["mission", "convert", "m.toml", "m.plan", *home]) == 0


def typed_in(endpoint: str, text: str, draft: Draft | None = None) -> tuple[int, str, str]:
    """Type it into a console of its own: exit code, result, notes."""
    shell = cli.parse(["hold", "--connect", endpoint])
    common = common_of(shell)
    with open_bus(common.network, Role.GROUND, common.robot) as bus:
        return asyncio.run(done([text], bus, common, draft or Draft()))[0]


async def done(
    texts: Sequence[str],
    bus: Bus,
    common: Common,
    draft: Draft,
    begun: Callable[[], object] = lambda: None,
) -> list[tuple[int, str, str]]:
    """Run typed lines as the app does, on one robot; call `begun` when that is open."""
    notes = Notes()
    robot = Robot(bus, common, leasing=Leasing.NEVER, follows=False, progress=notes)
    await robot.open()
    begun()
    try:
        return [await perform(text, robot, notes, draft) for text in texts]
    finally:
        robot._ways_to_stop()[1].close()  # a robot that is closed leaves its lease


async def perform(text: str, robot: Robot, notes: Notes, draft: Draft) -> tuple[int, str, str]:
    notes.notes.clear()
    try:
        operation: Any = read(text)
        if isinstance(operation, OfMissionFile):
            operation = replace(operation, draft=lambda: draft.ready)
        if operation.is_offline:
            outcome = operation.run(notes)
        else:
            outcome = await operation.perform(robot)
    except UserError as error:
        return 2, "", str(error)
    except RemoteError as error:
        return 1, "", str(error)
    return int(not outcome.ok), outcome.text, "\n".join(notes.notes)


def wanted(robot: PlayedRobot, *, lease: bool) -> list[Message]:
    """Return the messages that the robot received, without request ids and names of senders."""
    leases: list[Message] = [*robot.desk.actions[:1]] if lease else []
    asked = [*robot.asked, *leases, *robot.desk.frames]
    plain = [message for message in asked if "request_id" not in message.__struct_fields__]
    return [
        msgspec.structs.replace(message, request_id=0, **plain_of(message))
        for message in asked
        if "request_id" in message.__struct_fields__
    ] + plain


def plain_of(message: Message) -> dict[str, Any]:
    """Return what differs each time: who asks, and the id of what a clean-up ends, if any."""
    found: dict[str, Any] = {}
    if isinstance(message, CommandRequest | GoalRequest):
        found["sender"] = ""
    if isinstance(message, CommandRequest):
        found["ends_id"] = int(bool(message.ends_id))
    return found


@pytest.mark.usefixtures("_files")
@pytest.mark.parametrize(("typed", "argv"), TALKING)
def test_both_ask_for_the_same(
    typed: str, argv: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    draft = Draft()
    draft.add(Waypoint(x_m=1.5, y_m=2.0))
    lease = argv[0] == "lease"
    asked = []
    for here in (False, True):
        with played() as (robot, endpoint):
            robot.reach_goals()
            robot.pose = (1.0, 2.0, 0.5)
            if here:
                code, said, _ = typed_in(endpoint, typed, draft)
            else:
                offline = argv[:2] in (["mission", "check"], ["mission", "convert"])
                code = cli.main([*argv, *([] if offline else ["--connect", endpoint])])
                said = capsys.readouterr().out
            asked.append((code, said.split()[:1], wanted(robot, lease=lease)))
    assert asked[0][0] == asked[1][0]
    assert repr(asked[0][2]) == repr(asked[1][2])
    assert capsys.readouterr() == ("", "")


@pytest.mark.usefixtures("_files")
def test_a_goal_typed_in_the_app_is_attended_by_it_and_nothing_waits(
    stage: tuple[PlayedRobot, str],
) -> None:
    robot, endpoint = stage
    robot.answers = [Reason.NOT_ARMED]
    code, out, err = typed_in(endpoint, "goal 1 2 90")
    assert (code, out[:3], err) == (0, "ok ", "armed")
    assert robot.vehicle is Vehicle.ACTIVE
    goals = [message for message in robot.asked if isinstance(message, GoalRequest)]
    assert [goal.mode for goal in goals] == [Mode.GUIDED] * 2
    assert robot.desk.actions == []


@pytest.mark.usefixtures("_files")
def test_unattended_goal_is_auto_in_the_app(stage: tuple[PlayedRobot, str]) -> None:
    robot, endpoint = stage
    assert typed_in(endpoint, "goal 1 2 --no-wait")[0] == 0
    (goal,) = set(robot.asked)
    assert isinstance(goal, GoalRequest)
    assert goal.mode == Mode.AUTO


@pytest.mark.usefixtures("_files")
@pytest.mark.parametrize(
    ("typed", "code", "said"),
    [
        ("goal 9e9 0", 2, "x 9e+09 m is out of range"),
        ("goal 1 2 --timeout 3", 2, "--timeout cannot be used here"),
        ("get zzz", 2, "no parameter matches 'zzz'"),
        ("mission upload nowhere.toml", 2, "nowhere.toml: no such file"),
        ("wp upload", 2, "the draft is empty"),
        ("teleop 0.1 0", 2, "--for S is missing"),
    ],
)
def test_errors_are_printed_and_never_raised(
    stage: tuple[PlayedRobot, str], typed: str, code: int, said: str
) -> None:
    found, out, err = typed_in(stage[1], typed)
    assert (found, out) == (code, "")
    assert said in err


@pytest.mark.usefixtures("_files")
def test_a_robot_that_does_not_answer_is_explained(stage: tuple[PlayedRobot, str]) -> None:
    robot, endpoint = stage
    robot.answers = [None] * 3
    code, _, err = typed_in(endpoint, "hold --timeout 0.1")
    assert code == 1
    assert "sends its heartbeat, but does not answer" in err


@pytest.mark.usefixtures("_files")
def test_the_lease_taken_here_is_kept_by_the_app(stage: tuple[PlayedRobot, str]) -> None:
    robot, endpoint = stage
    assert typed_in(endpoint, "lease take --name anna")[0] == 0
    assert [request.action for request in robot.desk.actions] == [LeaseAction.TAKE]
    assert robot.desk.held is not None
    assert robot.desk.held[1] == "anna"


@pytest.mark.usefixtures("_files")
def test_a_long_session_does_not_listen_more_with_each_command(
    stage: tuple[PlayedRobot, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, endpoint = stage
    robot.pose = (0.0, 0.0, 0.0)
    common = common_of(cli.parse(["hold", "--connect", endpoint]))
    heard: list[object] = []
    forgotten: list[object] = []
    with open_bus(common.network, Role.GROUND, common.robot) as bus:
        mailbox, forget = bus.mailbox, bus.unsubscribe

        def listen(*how: Any, **named: Any) -> Mailbox[Any]:
            box: Mailbox[Any] = mailbox(*how, **named)
            heard.append(box)
            return box

        def leave(box: Mailbox[Any]) -> None:
            forgotten.append(box)
            forget(box)

        def watch() -> None:
            monkeypatch.setattr(bus, "mailbox", listen)
            monkeypatch.setattr(bus, "unsubscribe", leave)

        lines = [typed for typed, argv in TALKING if argv[0] != "lease"]
        asyncio.run(done(lines, bus, common, Draft(), watch))
    assert len(heard) > 10
    assert len(forgotten) == len(heard)
