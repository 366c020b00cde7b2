"""An operator at a terminal, a shell, and a MAVLink client."""

import os
import re
import shutil
import signal
import socket
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial
from itertools import cycle
from math import nan
from pathlib import Path
from secrets import randbits
from typing import Any, NamedTuple

import pyte
import pytest

from checks.harness.crew import LOCAL, Crew, Witness, children_of, cmdline, departs
from checks.harness.mavlink_client import MavlinkClient, UdpLine
from checks.harness.processes import Running, ask_until_accepted, command_request, free_port
from checks.harness.terminal import Terminal
from checks.harness.until import PATIENCE_S, until
from gateways.mavlink.mavlink_dialect import REQUEST_OPERATOR_CONTROL, mavlink
from ground.missions.files import read
from protocol.topics import COMMAND, MISSION
from protocol.wire.enums import Command, MissionState, Mode, Vehicle
from protocol.wire.messages import MissionStatus
from tests.support.screens import Tmux

USUAL = (80, 24)
READY = "read: ready"
KEYS = "ctrl+p Palette  ? Help"
FIRST_KEY = " space E-STOP  "
PROMPT = "r1:"
HINT = "? shows all keys"
GARBAGE = "goal 9 7\x07\r\nestop\t é✓\u202e{}[]'\"\\ $(reboot) `x` " + "A" * 3000
STORM = ((81, 25), (40, 12), (1, 1), (120, 30), (200, 60), (20, 5), (79, 23), (3, 40))


class Simulated(NamedTuple):
    """A robot and its plant, and an observer of what really happens."""

    endpoint: str
    robot: Running
    witness: Witness


@contextmanager
def simulated() -> Iterator[Simulated]:
    """Start a robot and its plant at the start of the world `open`."""
    with Crew(lockstep=True) as crew:
        robot = crew.robot()
        crew.plant()
        with Witness(crew.endpoint) as witness:
            yield Simulated(crew.endpoint, robot, witness)


@pytest.fixture(scope="module")
def shared() -> Iterator[Simulated]:
    """Start a robot for all tests that leave it alive and where it is."""
    with simulated() as found:
        yield found


@pytest.fixture
def stack(shared: Simulated) -> Iterator[Simulated]:
    """Provide the shared robot; release its emergency stop and disarm it after the test."""
    yield shared
    for command in (Command.SIDESTEP_CLEAR_EMERGENCY_STOP, Command.COMPONENT_ARM_DISARM):
        stop_id = shared.witness.status.stop_id
        request = partial(command_request, randbits(31), command, stop_id=stop_id)
        ask_until_accepted(shared.witness.bus, COMMAND, request, "r1", PATIENCE_S)
    shared.witness.ready()


@pytest.fixture
def own_stack() -> Iterator[Simulated]:
    """Start a robot for one test."""
    with simulated() as found:
        yield found


@contextmanager
def opened(
    stack: Simulated,
    folder: Path,
    size: tuple[int, int] = USUAL,
    environment: Mapping[str, str] | None = None,
) -> Iterator[Tmux]:
    """Open the app on a robot."""
    words = [sys.executable, "-m", "sidestep", "ground", "--connect", stack.endpoint, "--no-record"]
    with Tmux(folder, words, size, environment) as tmux:
        yield tmux


@pytest.mark.stack
@pytest.mark.skipif(shutil.which("tmux") is None, reason="no tmux on this machine")
def test_a_goal_by_the_cursor_a_navigator_an_estop_and_a_mission_by_keys_alone(
    own_stack: Simulated,
    tmp_path: Path,
) -> None:
    witness = own_stack.witness
    with opened(own_stack, tmp_path) as tmux:
        tmux.shows(READY)
        drive_to_the_cursor(tmux)
        until(lambda: witness.truth.speed_m_s > 0.2, what="driving")
        choose_navigator(tmux, "bug1")
        tmux.shows(" bug1/", "DRIVING")
        tmux.shows("│REACHED  ", "goal REACHED")
        assert abs(witness.truth.x_m - 2.2) < 0.15
        stop_at_once(tmux, witness)
        fly(tmux)
        tmux.shows("mission DONE (item 2 of 2)", within_s=60.0)
        tmux.type(":quit")
        tmux.press("Enter")
        assert tmux.ends() == 0


def drive_to_the_cursor(tmux: Tmux) -> None:
    """Eight steps of the cursor, which are 1.6 m, and Enter."""
    tmux.press("G")
    tmux.press(*["Right"] * 8)
    tmux.shows("goal 2.2 2:")
    tmux.press("Enter")
    tmux.shows("GUIDED", " ARMED")


def choose_navigator(tmux: Tmux, name: str) -> None:
    """Choose a navigator by its number in the menu, which begins at the one in force."""
    tmux.press("v")
    numbered = re.search(rf"│ (\d) +{name} ", tmux.shows("│ navigator ", f" {name} ", "/ filters"))
    assert numbered is not None
    tmux.press(numbered[1])
    tmux.shows(f"navigator {name}: ok")


def stop_at_once(tmux: Tmux, witness: Witness) -> None:
    """Press the emergency stop during a drive, then release it with two presses."""
    tmux.type(":goal 4 2")
    tmux.press("Enter")
    until(lambda: witness.truth.speed_m_s > 0.2, what="driving")
    tmux.press("Space")
    tmux.shows("▸ E-STOP ", "EMERGENCY STOP r1", "by you", "E-STOP acknowledged by r1")
    until(witness.standing, what="standing")
    tmux.press("D")
    tmux.shows("press D again")
    tmux.press("D")
    tmux.shows("▸ DISARMED", "clear-estop: ok")


def fly(tmux: Tmux) -> None:
    """Upload two waypoints from the cursor, arm, and start the mission."""
    tmux.press("G")
    tmux.press("Right", "Right", "w")
    tmux.shows("waypoint 1")
    tmux.press("Up", "Up", "w")
    tmux.shows("waypoint 2")
    tmux.press("Escape")
    tmux.shows("r1:")
    for line, answer in (
        ("wp upload", "2 waypoints"),
        ("arm", " ARMED"),
        ("mission start", "AUTO"),
    ):
        tmux.type(f":{line}")
        tmux.press("Enter")
        # The line of the last answer keeps it; newer lines of the log may hide the one there.
        tmux.shows(f" {line}: ", answer)


@pytest.mark.stack
@pytest.mark.skipif(shutil.which("tmux") is None, reason="no tmux on this machine")
@pytest.mark.parametrize("environment", [{"NO_COLOR": "1", "LC_ALL": "C"}, {"TERM": "linux"}])
def test_a_poor_terminal_shows_it_too(
    stack: Simulated, tmp_path: Path, environment: dict[str, str]
) -> None:
    with opened(stack, tmp_path, environment=environment) as tmux:
        screen = tmux.shows(READY, KEYS, "SIM")
        assert screen.isascii()
        if "NO_COLOR" in environment:
            assert "\x1b[38;2" not in tmux.coloured
            assert "\x1b[31" not in tmux.coloured
        tmux.press("4")
        tmux.shows("f Follow")
        tmux.press("C-q")
        assert tmux.ends() == 0


@pytest.mark.stack
@pytest.mark.skipif(shutil.which("tmux") is None, reason="no tmux on this machine")
@pytest.mark.parametrize("size", [(1, 1), (300, 90)])
def test_it_fits_any_terminal(stack: Simulated, tmp_path: Path, size: tuple[int, int]) -> None:
    with opened(stack, tmp_path, size) as tmux:
        until(lambda: tmux.screen.strip(), what="anything on the screen")
        tmux.resize(*USUAL)
        tmux.shows(READY, KEYS)
        tmux.resize(20, 5)
        tmux.resize(*size)
        tmux.press("F12")
        until(lambda: "STOP" in vehicle(stack.witness), what="the e-stop, unseen")
        tmux.press("C-q")
        assert tmux.ends() == 0


@pytest.mark.stack
@pytest.mark.skipif(shutil.which("tmux") is None, reason="no tmux on this machine")
def test_a_storm_of_sizes_leaves_it_as_it_was(own_stack: Simulated, tmp_path: Path) -> None:
    with opened(own_stack, tmp_path) as tmux:
        tmux.shows(READY, KEYS)
        for _, size in zip(range(80), cycle(STORM), strict=False):
            tmux.resize(*size)
        tmux.resize(*USUAL)
        screen = tmux.shows(READY, KEYS, "pose   0.60   2.00")
        assert len(screen.splitlines()) == USUAL[1]
        drive_to_the_cursor(tmux)


@pytest.mark.stack
@pytest.mark.skipif(shutil.which("tmux") is None, reason="no tmux on this machine")
def test_garbage_that_is_pasted_moves_nothing_and_breaks_nothing(
    stack: Simulated, tmp_path: Path
) -> None:
    with opened(stack, tmp_path) as tmux:
        tmux.shows(READY)
        tmux.paste(GARBAGE)
        tmux.press(":")
        tmux.paste(GARBAGE[::-1])
        tmux.shows("AAAA")
        tmux.press("Enter")
        tmux.shows("W ground AAAA")
        tmux.type(":hold")
        tmux.press("Enter")
        tmux.shows("I ground hold: ok")
        assert stack.witness.standing()
        assert "STOP" not in vehicle(stack.witness)


HOSTILE = {
    "control characters": (
        "\x1b[2J\x1b]52;c;QQ==\x07\x1b[31m a R D D \x1b",
        "\x00" * 5000,
        "x\x1b[201~ a R D D ",
    ),
    "a megabyte": ("goal 9 7 " * 120_000,),
}


@pytest.mark.stack
@pytest.mark.skipif(shutil.which("tmux") is None, reason="no tmux on this machine")
@pytest.mark.parametrize("texts", HOSTILE.values(), ids=HOSTILE)
def test_whatever_is_pasted_presses_no_key_and_the_next_key_counts(
    stack: Simulated, tmp_path: Path, texts: tuple[str, ...]
) -> None:
    with opened(stack, tmp_path) as tmux:
        tmux.shows(READY)
        for text in texts:
            tmux.paste(text)
        tmux.press("F12")
        tmux.shows("E-STOP acknowledged")
        tmux.press("4")
        screen = tmux.shows("f Follow", "E-STOP acknowledged")
        for word in ("arm", "rtl", "press D", "clear-estop"):
            assert f"ground {word}" not in screen


@pytest.mark.stack
@pytest.mark.skipif(shutil.which("tmux") is None, reason="no tmux on this machine")
def test_a_paste_that_never_ends_and_bytes_that_are_no_text_swallow_no_key(
    stack: Simulated, tmp_path: Path
) -> None:
    with opened(stack, tmp_path) as tmux:
        tmux.shows(READY)
        tmux.send_bytes(b"\x1b[200~ D a R")

        def counts() -> bool:
            tmux.press("h")
            return "hold: ok" in tmux.screen

        until(counts, what="a key that counts")
        tmux.send_bytes(b"\xff\xfe\x1b[99999999999u\x1b[48;;;;t\x1b[24~")
        tmux.shows("E-STOP acknowledged")


@pytest.mark.stack
@pytest.mark.skipif(shutil.which("tmux") is None, reason="no tmux on this machine")
def test_nothing_but_the_app_writes_to_the_terminal(own_stack: Simulated, tmp_path: Path) -> None:
    """The robot is the hub: its end closes the link, about which libraries log much."""
    with opened(own_stack, tmp_path) as tmux:
        before = tmux.shows(READY, KEYS)
        own_stack.robot.send(signal.SIGKILL)
        dead = tmux.shows("ROBOT DEAD")
        assert frame(dead) == frame(before)
        tmux.resize(81, 24)
        tmux.resize(*USUAL)
        tmux.shows(KEYS)
        assert frame(tmux.screen) == frame(before)
        for word in ("zenoh", "Traceback", "WARN", "panicked"):
            assert word not in tmux.screen


def vehicle(witness: Witness) -> str:
    return Vehicle(witness.status.vehicle).name


def frame(screen: str) -> list[str]:
    """Return the constant parts of the screen: the rule above the log, both ends of the prompt and
    of the keys, between which are those that are of use now.
    """
    lines = screen.splitlines()
    rule, prompt, keys = (lines[at] for at in (-6, -2, -1))
    assert set(rule) == {"─"}
    ends = prompt[: len(PROMPT)], prompt.rstrip()[-len(HINT) :]
    return [rule, *ends, keys[: len(FIRST_KEY)], keys[-len(KEYS) :]]


SIZE = (100, 30)


class Screen:
    """An emulated terminal: what the app has drawn on it until now."""

    def __init__(self, terminal: Terminal) -> None:
        self._terminal, self._fed = terminal, 0
        self._screen = pyte.Screen(*SIZE)
        self._stream = pyte.Stream(self._screen)

    def __str__(self) -> str:
        text = self._terminal.text().rstrip("\ufffd")  # of a character only a part was read
        self._stream.feed(text[self._fed :])
        self._fed = len(text)
        return "\n".join(self._screen.display)

    def shows(self, *words: str) -> None:
        """Wait until all these words are on the screen."""
        until(
            lambda: all(word in str(self) for word in words),
            what=lambda: f"{words}:\n{self}",
            poll_s=0.05,
        )


@pytest.mark.stack
@pytest.mark.brief
def test_drive_is_drawn_to_its_end_and_space_stops_the_robot() -> None:
    with Terminal(("up", "--speed", "10"), SIZE) as terminal:
        screen = Screen(terminal)
        screen.shows("● r1", "AUTO", "goal", "pose", "space E-STOP")
        screen.shows("REACHED", "reached in", "100 %")
        terminal.type(" ")
        screen.shows("EMERGENCY")
        assert "Traceback" not in terminal.text()


DRIVE_S = 60.0
TOUR = """
[[waypoint]]
x_m = 0.8
y_m = 2.0
hold_s = 0.3

[[waypoint]]
x_m = 1.0
y_m = 2.0

[fence.circle]
x_m = 1
y_m = 2
radius_m = 2
"""


@pytest.fixture(scope="module")
def scene() -> Iterator[tuple[Crew, Witness]]:
    """Start a robot in standby in a world, and an observer; each test leaves it at rest."""
    with Crew(lockstep=True) as crew:
        crew.robot()
        crew.plant()
        with Witness(crew.endpoint) as witness:
            witness.ready()
            yield crew, witness


def done(crew: Crew, *words: str, code: int = 0) -> str:
    """Run a verb, require its exit code, and return its output."""
    ended, said = crew.run(*words)
    assert ended == code, said
    assert "Traceback" not in said
    return said


@pytest.mark.stack
def test_a_mission_is_driven_from_a_file_and_comes_back_as_one(
    scene: tuple[Crew, Witness], tmp_path: Path
) -> None:
    path, back = tmp_path / "tour.toml", tmp_path / "back.toml"
    path.write_text(TOUR)
    crew, witness = scene
    mission = witness.bus.mailbox(MISSION, "r1")

    def over() -> bool:
        newest = mission.latest()
        status = newest[0] if newest else None
        return isinstance(status, MissionStatus) and status.state == MissionState.DONE

    done(crew, "mission", "upload", str(path))
    done(crew, "arm")
    done(crew, "mission", "start")
    until(over, within_s=DRIVE_S, what="the mission is done")
    assert done(crew, "mission", "status") == "done, item 2 of 2\n"
    assert "outside of the fence" in done(crew, "goto", "5", "2", code=1)
    done(crew, "mission", "download", str(back))
    assert read(back) == read(path)
    done(crew, "fence", "off")


@pytest.mark.stack
def test_second_operator_sees_the_first_and_may_stop_the_robot(
    scene: tuple[Crew, Witness], monkeypatch: pytest.MonkeyPatch
) -> None:
    crew, witness = scene
    goto = departs(crew, witness, "goto", "5.4", "2")
    monkeypatch.setenv("SIDESTEP_PERSON", "ben")
    assert "another operator commands the robot: " in done(crew, "goto", "1", "1", code=1)
    done(crew, "hold")
    monkeypatch.delenv("SIDESTEP_PERSON")
    until(witness.standing)
    assert "commands r1" in done(crew, "lease", "show")
    done(crew, "estop")
    until(witness.standing)
    assert goto.ends() == 1
    # A program of this person that ended just before may count as there for 2.5 s of the robot.
    until(lambda: done(crew, "lease", "show") == "no operator holds the lease\n")
    done(crew, "clear-estop")


@pytest.mark.stack
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_teleop_robot_stops_when_its_operator_exits(
    scene: tuple[Crew, Witness], number: signal.Signals
) -> None:
    crew, witness = scene
    hand = crew.dialling("teleop", "0.3", "20")
    until(lambda: witness.truth.speed_m_s > 0.1)
    assert witness.status.mode == Mode.MANUAL
    hand.send(number)
    until(witness.standing, what="standing")
    assert hand.ends() == (130 if number is signal.SIGINT else -number)


SLOW_DRIVE = ("up", "--headless", "--speed", "0.3")
"""So that it lasts until a busy computer has started the gateway again."""


def gateway_of(parent: int) -> int:
    """Return the process id of the gateway that `up` has started."""
    (found,) = (child for child in children_of(parent) if "gateway" in cmdline(child))
    return found


def is_driving(heartbeat: Any) -> bool:
    armed = heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    return bool(armed) and heartbeat.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA


@pytest.mark.stack
@pytest.mark.brief
def test_client_of_up_replaces_its_goal_and_stops_the_robot() -> None:
    port = free_port(socket.SOCK_DGRAM)
    with Crew() as crew, ExitStack() as here:
        up = crew.start(*SLOW_DRIVE, "--world", "open", "--mavlink", f"udpin:{LOCAL}:{port}")
        client = here.enter_context(MavlinkClient(UdpLine(port)))
        client.next("HEARTBEAT", is_driving)
        first = client.next("GLOBAL_POSITION_INT")
        second = client.next("GLOBAL_POSITION_INT", lambda one: one.lon != first.lon)
        gateway = gateway_of(up.process.pid)
        os.kill(gateway, signal.SIGKILL)
        up.says("the gateway process was killed (signal SIGKILL); restarting")
        client.next("HEARTBEAT", is_driving)
        client.next("GLOBAL_POSITION_INT", lambda one: one.lon != second.lon)
        assert gateway_of(up.process.pid) != gateway
        place = client.next("GLOBAL_POSITION_INT")
        goal = -1.0, 1.0, 0.0, nan, place.lat, place.lon, 0.0  # as floats they were 0.4 m off
        frame, number = mavlink.MAV_FRAME_GLOBAL_INT, mavlink.MAV_CMD_DO_REPOSITION
        client.send(mavlink.MAVLink_command_int_message(1, 1, frame, number, 0, 0, *goal))
        until(  # it may have come by now
            lambda: "MISSION_ITEM_REACHED" in client.newest,
            lambda: (client.texts[-8:], up.said[-900:]),
        )
        assert client.newest["MISSION_ITEM_REACHED"].seq == 0
        up.says("goal replaced, an operator commands")
        client.command(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1.0)
        up.says("an operator commands")
        client.command(REQUEST_OPERATOR_CONTROL, 0.0)
        up.says("ends in ")
        up.send(signal.SIGINT)
        assert up.ends() == 130
        assert "emergency stop" in up.said
        assert "Traceback" not in up.said, up.said
