"""Each way of a stop is sufficient alone, and a key press reaches the bus by few calls."""

import asyncio
import json
import os
import socket
import stat
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager, suppress
from contextvars import ContextVar
from dataclasses import replace
from pathlib import Path
from threading import Event, Thread
from types import FrameType
from typing import Any

import pytest

from checks.harness.until import PATIENCE_S, until
from ground.app.app import GroundApp
from ground.app.appearance import Appearance
from ground.app.commands.runner import CommandRunner
from ground.client.connection import Common, given
from ground.client.emergency_stop import FRESH_NS, EmergencyStop, StopWays
from ground.client.robot_link import RobotLink, open_link
from ground.client.stop_datagrams import StopDatagrams
from ground.client.stop_ways import (
    MOST_BYTES,
    SideWays,
    StopServer,
    near,
    socket_folder,
    stem_of,
    ways_of,
)
from ground.commands.stop import StopAll, StopNow
from ground.console.history import History
from protocol.bus.network import Network
from protocol.bus.services import Requester, ServiceQuery
from protocol.stop_datagram import OPEN_SECRET, press_in, sealed_answer
from protocol.topics import COMMAND, PARAMETER, Service
from protocol.wire.enums import Vehicle
from protocol.wire.message import Message
from runtime.clock import WallClock
from runtime.errors import RemoteError
from tests.support.played_robot import PlayedRobot
from tests.support.stacks import Lively, watching

CLOCK = WallClock()


class Unheard:
    """A publisher whose messages do not arrive."""

    def put(self, message: Message) -> None:
        """Lose a message."""


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the user's folder: with a path that is too long for a local socket."""
    folder = tmp_path / ("long" * 30)
    monkeypatch.setenv("XDG_STATE_HOME", str(folder))
    return folder


@pytest.fixture
def common(stage: tuple[PlayedRobot, str]) -> Common:
    return given(stage[1], "r1", None)


@contextmanager
def served(common: Common) -> Iterator[RobotLink]:
    """Have a program with an open session on this machine."""
    with open_link(common) as link, StopServer(link) as server:
        assert server.why == ""
        yield link


def alone(ways: StopWays) -> EmergencyStop:
    """Return a stop without a session of its own."""
    return EmergencyStop(None, None, "r1", CLOCK, lambda: None, ways)


@pytest.mark.usefixtures("state")
def test_a_stop_uses_the_open_session_of_another_program(
    robot: PlayedRobot, common: Common
) -> None:
    with served(common), closing(SideWays(common, None)) as ways:
        stop = alone(ways)
        ways.ask_others(stop.request_id)
        outcome = stop.run()
    assert outcome.acknowledged
    assert outcome.way.startswith("by the session of process ")
    assert robot.stop_id == stop.request_id


@pytest.mark.usefixtures("state")
def test_the_socket_is_for_this_user_and_ends_with_its_program(common: Common) -> None:
    with served(common):
        (path,) = socket_folder().iterdir()
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    assert list(socket_folder().iterdir()) == []


@pytest.mark.usefixtures("state")
def test_the_socket_of_a_killed_program_is_removed(common: Common) -> None:
    with served(common):
        (path,) = socket_folder().iterdir()
    with socket.socket(socket.AF_UNIX) as left, near(path.parent) as folder:
        left.bind(f"{folder}/{path.name}")
    assert path.exists()
    with closing(SideWays(common, None)) as ways:
        ways.ask_others(5)
        until(lambda: not path.exists())
        assert ways.stopped_by(5) == ""


@pytest.mark.usefixtures("state")
@pytest.mark.parametrize("how", ["others may write", "another user", "no folder"])
def test_a_folder_that_others_can_write_to_is_not_believed(
    how: str, common: Common, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A false program there could say that the robot has stopped."""
    folder = socket_folder()
    folder.mkdir(parents=True, mode=0o700)
    if how == "others may write":
        folder.chmod(0o770)
    elif how == "another user":
        monkeypatch.setattr("ground.client.stop_ways.os.geteuid", lambda: os.getuid() + 1)
    else:
        folder.rename(folder.with_name("elsewhere"))
        folder.symlink_to("elsewhere")
    fake = folder / f"{stem_of(common)}.1.sock"
    with socket.socket(socket.AF_UNIX) as listener, near(folder) as short:
        listener.bind(f"{short}/{fake.name}")
        listener.listen()
        listener.settimeout(0.2)
        with closing(SideWays(common, None)) as ways:
            ways.ask_others(5)
            assert str(folder) in ways.others_why
            with pytest.raises(TimeoutError):
                listener.accept()
    with open_link(common) as link, StopServer(link) as server:
        assert str(folder) in server.why


@pytest.mark.usefixtures("state")
def test_a_stop_by_its_own_session_is_not_called_by_a_new_one(
    robot: PlayedRobot, common: Common
) -> None:
    stopped = StopNow(timeout_s=50.0).perform_alone(common)
    assert stopped.ok
    assert "by a new session" not in stopped.text


@pytest.mark.usefixtures("state")
@pytest.mark.parametrize(
    "words",
    [
        b"",
        b"\n",
        b"stop\n",
        b"[]\n",
        b"{}\n",
        b'{"robot": 5, "request_id": 1}\n',
        b'{"robot": "R/1", "request_id": 1}\n',
        b'{"robot": "r1", "request_id": "1"}\n',
        b"x" * (2 * MOST_BYTES),
    ],
)
def test_no_other_words_on_the_socket_have_an_effect(
    robot: PlayedRobot, common: Common, words: bytes
) -> None:
    with served(common):
        (path,) = socket_folder().iterdir()
        for sent in (words, json.dumps({"robot": "r1", "request_id": 9}).encode() + b"\n"):
            with socket.socket(socket.AF_UNIX) as asking, near(path.parent) as folder:
                asking.connect(f"{folder}/{path.name}")
                asking.settimeout(60.0)
                with suppress(ConnectionError):
                    asking.sendall(sent)
                    answer = asking.recv(MOST_BYTES)
    assert json.loads(answer) == {"acknowledged": True}
    assert robot.stop_id == 9


@pytest.mark.usefixtures("state")
def test_programs_at_other_endpoints_are_not_asked(common: Common) -> None:
    others = given("tcp/127.0.0.1:1", "r1", None)
    assert stem_of(common) != stem_of(others)
    with served(common), closing(SideWays(others, None)) as ways:
        ways.ask_others(5)
        assert ways.stopped_by(5) == ""


@pytest.mark.usefixtures("state")
def test_a_stop_that_is_not_acknowledged_opens_a_fresh_session(
    robot: PlayedRobot, common: Common
) -> None:
    with open_link(common) as link, closing(ways_of(link.bus, "r1")) as ways:
        stop = EmergencyStop(None, Unheard(), "r1", CLOCK, lambda: None, ways)
        outcome = stop.run()
    assert outcome.acknowledged
    assert outcome.way == "by a new session"
    assert outcome.took_ns >= FRESH_NS
    assert robot.stop_id == stop.request_id
    assert robot.vehicle is Vehicle.EMERGENCY_STOP


@pytest.mark.usefixtures("state")
def test_beside_a_bus_that_is_played_there_is_no_other_way() -> None:
    ways = ways_of(object(), "r1")
    stop = alone(ways)
    stop.press()
    assert stop.run(give_up_ns=0).acknowledged is False
    ways.close()


@contextmanager
def played_robot() -> Iterator[tuple[socket.socket, Common]]:
    """Yield a socket for stop datagrams, and how to dial it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as robot:
        robot.bind(("127.0.0.1", 0))
        robot.settimeout(PATIENCE_S)
        yield robot, given(f"tcp/127.0.0.1:{robot.getsockname()[1]}", "r1", None)


class Blocked:
    """A bus that blocks whoever asks."""

    def __init__(self) -> None:
        self.released = Event()

    def ask(self, *_: object, **__: object) -> bytes:
        self.released.wait()
        raise RemoteError("it has hung")


@pytest.mark.usefixtures("state")
def test_a_bus_that_blocks_does_not_hold_up_the_datagrams() -> None:
    bus = Blocked()
    with played_robot() as (robot, dialled):
        with closing(SideWays(dialled, None)) as ways, ThreadPoolExecutor(1) as pool:
            stop = EmergencyStop(bus, None, "r1", CLOCK, lambda: None, ways)
            running = pool.submit(stop.run, bus.released.is_set)
            try:
                received = {robot.recv(200) for _ in range(5)}
            finally:
                bus.released.set()
            assert not running.result().acknowledged
        assert len(received) == 5, "each with a time of its own"


@pytest.mark.usefixtures("state")
def test_a_repetition_ends_with_its_stop() -> None:
    with played_robot() as (robot, dialled), closing(SideWays(dialled, None)) as ways:
        ways.press(7)
        robot.recv(200)
        ways.end_session()
        until(lambda: ways._repeating is None)
        ways.press(8)
        until(lambda: robot.recv(200)[-40:-32] == (8).to_bytes(8, "little"))


@pytest.mark.usefixtures("state")
def test_a_repetition_ends_with_the_answer_of_the_robot() -> None:
    """A later clear of another operator must not be undone while the own bus hangs."""
    with played_robot() as (robot, dialled), closing(SideWays(dialled, None)) as ways:
        ways.press(7)
        packet, sender = robot.recvfrom(200)
        press = press_in(packet, "r1", lambda _: OPEN_SECRET)
        assert press is not None
        robot.sendto(sealed_answer(OPEN_SECRET, "r1", press, stopped=True), sender)
        until(lambda: ways._repeating is None, what="the end")
        assert ways.stopped_by(7) == "by datagram"
        ways.press(7)
        assert ways._repeating is None


@pytest.mark.usefixtures("state")
def test_a_system_without_another_thread_sends_each_press(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: Thread) -> None:
        raise RuntimeError("can't start new thread")

    with played_robot() as (robot, dialled), closing(SideWays(dialled, None)) as ways:
        with monkeypatch.context() as patch:
            patch.setattr(Thread, "start", refuse)
            ways.press(7)
            ways.press(7)
        assert robot.recv(200) != robot.recv(200), "each with a time of its own"


@pytest.mark.usefixtures("state")
def test_one_of_several_addresses_is_enough(common: Common) -> None:
    with closing(StopDatagrams(common.network, "r1", None)) as datagrams:
        datagrams._literal.insert(0, (socket.AF_INET, ("255.255.255.255", 9)))  # not permitted
        datagrams.press(7)
        assert datagrams.why == ""
        del datagrams._literal[1:]
        datagrams.press(8)
        assert "no datagram could be sent to 255.255.255.255" in datagrams.why


@pytest.mark.usefixtures("state")
def test_a_stop_that_another_part_has_delivered_tries_no_further() -> None:
    nobody = given("tcp/127.0.0.1:1", "r1", None)
    stopped = StopNow(timeout_s=50.0).perform_alone(nobody, opens=False, is_met=lambda: True)
    assert not stopped.ok
    assert stopped.stop.tries == 1


@pytest.mark.usefixtures("state")
def test_a_robot_known_by_name_that_nobody_reaches_fails_the_stop_of_all(
    robot: PlayedRobot, common: Common
) -> None:
    known = replace(common.network, stop_at={"r9": "127.0.0.1:9"})
    outcome = StopAll(timeout_s=1.0).perform_alone(replace(common, network=known))
    assert {name: one.ok for name, one in outcome.of} == {"r1": True, "r9": False}
    assert robot.vehicle is Vehicle.EMERGENCY_STOP


@pytest.mark.usefixtures("state")
def test_the_stop_of_all_reaches_a_robot_whose_name_nobody_gave(
    robot: PlayedRobot, common: Common
) -> None:
    unnamed = replace(common, robot="r7")
    outcome = StopAll(timeout_s=50.0).perform_alone(unnamed)
    assert {name: one.ok for name, one in outcome.of} == {"r1": True}


ROOT = Path(__file__).resolve().parents[2]
LIMIT = 15
BEGINNINGS = ("app.action_do", "command_line.action_submit")
"""What is before only brings keys into order."""


def calls(frame: FrameType | None) -> list[str]:
    """Functions of the product on a stack from a key on, the outermost first; empty without one."""
    found: list[str] = []
    while frame is not None:
        path = Path(frame.f_code.co_filename)
        if path.is_relative_to(ROOT / "ground") or path.is_relative_to(ROOT / "protocol"):
            found.insert(0, f"{path.stem}.{frame.f_code.co_name}")
        if found and found[0] in BEGINNINGS:
            return found
        frame = frame.f_back
    return found if PATH.get() else []


PATH: ContextVar[tuple[str, ...]] = ContextVar("PATH", default=())
"""The calls that led to the present task."""


def task_of_calls(loop: asyncio.AbstractEventLoop, work: Any, **how: Any) -> asyncio.Task[Any]:
    """Begin a task that knows the calls that led to it."""
    token = PATH.set((*PATH.get(), *calls(sys._getframe(1))))
    try:
        return asyncio.Task(work, loop=loop, **how)
    finally:
        PATH.reset(token)


@pytest.mark.parametrize(
    ("keys", "service"),
    [
        (("h",), COMMAND),
        (("G", "right", "enter"), COMMAND),
        (("3", "enter", "0", "full_stop", "3", "enter"), PARAMETER),
    ],
    ids=["command", "goal", "parameter"],
)
def test_key_reaches_the_bus_in_fifteen_calls(
    keys: tuple[str, ...], service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    to_bus: list[str] = []
    send = Requester.send

    def asked(self: Requester, query: ServiceQuery, done: Any) -> None:
        if query.service is service and not to_bus and PATH.get():
            to_bus[:] = [*PATH.get(), *calls(sys._getframe().f_back), "send"]
        send(self, query, done)

    monkeypatch.setattr(Requester, "send", asked)
    with Lively() as stack, stack.going(), watching(stack) as seen:
        seen.until_ready()
        common = Common(network=Network(), robot="r1")
        commands = CommandRunner(lambda: seen.station, common, History())
        app = GroundApp(seen.station, commands, None, Appearance(hz=0.0))

        async def press() -> None:
            asyncio.get_running_loop().set_task_factory(task_of_calls)
            async with app.run_test() as pilot, asyncio.timeout(PATIENCE_S):
                for key in keys:
                    await pilot.press(key)
                    app.redraw()
                while not to_bus or seen.station.queue.busy:
                    app.sample()
                    await pilot.pause(0.02)

        asyncio.run(press())
    assert to_bus[0] in BEGINNINGS
    assert len(to_bus) <= LIMIT, f"{len(to_bus)}: {' '.join(to_bus)}"
