"""The app's console sends the robot the same requests as the command line, over a real bus."""

import sys
from collections.abc import Iterator
from io import StringIO
from pathlib import Path
from typing import Any

import msgspec
import pytest

from ground.cli import main as cli
from ground.cli.options import common_of
from ground.client.link import Link
from ground.client.operations.session import Session
from ground.console.app_commands import AppCommand
from ground.console.parser import read
from ground.missions.draft import Draft
from ground.missions.mission import Waypoint
from protocol.bus.bus import open_bus
from protocol.bus.mailbox import Mailbox
from protocol.topics import Role
from protocol.wire.enums import GoalState, LeaseAction, Mode, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import CommandRequest, GoalRequest
from protocol.wire.reasons import Reason
from runtime.clock import WallClock
from runtime.errors import RemoteError, UserError
from tests.support.bus.robots import PlayedRobot, played
from tests.support.ground.client import Notes
from tests.support.ground.console.spoken import SPOKEN

OF_RECORDINGS = ("explain", "ghost", "mark", "plot")
ENDLESS = ("watch", "ground")
TALKING = [(typed, argv) for typed, argv in SPOKEN if argv[0] not in OF_RECORDINGS + ENDLESS]
MISSION = "[[waypoint]]\nx_m = 1.5\ny_m = 2\n"


@pytest.fixture(autouse=True)
def _files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "stdin", StringIO(MISSION))
    (tmp_path / "m.toml").write_text(MISSION)
    (tmp_path / "q.toml").write_text("[parameters]\nd_obs_m = 0.6\n")
    home = ("--home", "47.4", "8.5")
    assert cli.main(["mission", "convert", "m.toml", "m.plan", *home]) == 0


@pytest.fixture
def stage() -> Iterator[tuple[PlayedRobot, str]]:
    with played() as found:
        yield found


def typed_in(endpoint: str, text: str, draft: Draft | None = None) -> tuple[int, str, str]:
    """Type it into a console of its own: exit code, result, notes."""
    shell = cli.parse(["hold", "--connect", endpoint])
    common = common_of(shell)
    with open_bus(common.network, Role.GROUND, common.robot) as bus:
        return done(text, Link(bus, common, WallClock()), draft or Draft())


def done(text: str, link: Link, draft: Draft) -> tuple[int, str, str]:
    """Run a typed line as the app does, over its link."""
    notes = Notes()
    try:
        operation = read(text, lambda: draft.text)
        assert not isinstance(operation, AppCommand)
        outcome = operation.perform(Session(link, notes, attended=True))
    except UserError as error:
        return 2, "", str(error)
    except RemoteError as error:
        return 1, "", str(error)
    return int(not outcome.ok), outcome.text, "\n".join(notes.notes)


def wanted(robot: PlayedRobot, *, lease: bool) -> list[Message]:
    """Return the messages that the robot received, without request ids."""
    leases: list[Message] = [*robot.desk.actions[:1]] if lease else []
    asked = [*robot.asked, *leases, *robot.desk.frames]
    plain = [message for message in asked if "request_id" not in message.__struct_fields__]
    return [
        msgspec.structs.replace(message, request_id=0, **ended(message))
        for message in asked
        if "request_id" in message.__struct_fields__
    ] + plain


def ended(message: Message) -> dict[str, int]:
    """Return whether a clean-up names what it ends, whose id is another one each time."""
    return {"ends_id": int(bool(message.ends_id))} if isinstance(message, CommandRequest) else {}


def arrives(robot: PlayedRobot) -> None:
    def arrive() -> None:
        robot.goal = GoalState.REACHED

    robot.after_goal = arrive


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
            arrives(robot)
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


def test_unattended_goal_is_auto_in_the_app(stage: tuple[PlayedRobot, str]) -> None:
    robot, endpoint = stage
    assert typed_in(endpoint, "goal 1 2 --no-wait")[0] == 0
    (goal,) = set(robot.asked)
    assert isinstance(goal, GoalRequest)
    assert goal.mode == Mode.AUTO


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


def test_a_robot_that_does_not_answer_is_explained(stage: tuple[PlayedRobot, str]) -> None:
    robot, endpoint = stage
    robot.answers = [None] * 3
    code, _, err = typed_in(endpoint, "hold --timeout 0.1")
    assert code == 1
    assert "sends its heartbeat, but does not answer" in err


def test_the_lease_taken_here_is_kept_by_the_app(stage: tuple[PlayedRobot, str]) -> None:
    robot, endpoint = stage
    assert typed_in(endpoint, "lease take --name anna")[0] == 0
    assert [request.action for request in robot.desk.actions] == [LeaseAction.TAKE]
    assert robot.desk.held is not None
    assert robot.desk.held[1] == "anna"


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

        monkeypatch.setattr(bus, "mailbox", listen)
        monkeypatch.setattr(bus, "unsubscribe", leave)
        for typed, argv in TALKING:
            if argv[0] != "lease":
                done(typed, Link(bus, common, WallClock()), Draft())
    assert len(heard) > 10
    assert len(forgotten) == len(heard)
