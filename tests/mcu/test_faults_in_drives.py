"""Real processes with the core on the emulated board, of which one fails in mid-drive.

The simulation is paced, so all limits are in simulated time and a busy machine does not matter.
"""

import json
import os
import re
import signal
from pathlib import Path
from typing import Final

import pytest

from checks.harness.crew import Crew, Witness, alive, children_of, cmdline
from checks.harness.observer import is_still
from checks.harness.processes import Running
from checks.harness.until import until
from ground.recording.log_reader import TlogReader
from protocol.wire.codec import decode
from protocol.wire.message import Message
from protocol.wire.messages import GroundTruth, Statustext, WheelCommand
from runtime.units import NS_PER_MS as MS
from runtime.units import PERIOD_MS

pytestmark = pytest.mark.mcu

SOON_S: Final = 60.0
STOPPED_MS: Final = 200
"""The documented limit after the end of a robot process."""
"""Resolution of the truth."""
TICKS_AFTER: Final = 10
EMULATOR: Final = "qemu-system-arm "
ROBOT: Final = " robot "
CUT: Final = "the line to the board is cut, or its emulator has ended"
STUCK: Final = "the board hangs or its line is stuck: no answer for 3 s"
UP: Final = ("up", "--mcu", "--headless", "--json", "--plain", "--world", "open")


def family_of(running: Running) -> list[int]:
    """Return a process and all below it."""
    return [running.process.pid, *descendants(running.process.pid)]


def descendants(pid: int) -> list[int]:
    try:
        children = children_of(pid)
    except (FileNotFoundError, ProcessLookupError):
        return []
    return [one for child in children for one in (child, *descendants(child))]


def signal_one(running: Running, words: str, number: signal.Signals) -> None:
    """Signal the only process of a family with these words in its command line."""
    (pid,) = [one for one in family_of(running) if words in cmdline(one)]
    os.kill(pid, number)


def none_left(family: list[int]) -> None:
    until(lambda: not [pid for pid in family if alive(pid)], what="the end of all processes")


def messages_in(folder: Path) -> list[Message]:
    """Return the messages of the only recording."""
    (log,) = folder.glob("*.tlog")
    with log.open("rb") as source:
        return [decode(record.frame).message for record in TlogReader(source)]


def texts_in(messages: list[Message]) -> str:
    return "".join(one.text for one in messages if isinstance(one, Statustext))


@pytest.mark.usefixtures("firmware")
@pytest.mark.parametrize(
    ("victim", "number", "code", "words"),
    [
        (EMULATOR, signal.SIGKILL, 1, CUT),
        (EMULATOR, signal.SIGSTOP, 1, STUCK),
        (ROBOT, signal.SIGKILL, -signal.SIGKILL, ""),
    ],
)
def test_fault_in_mid_drive_stops_the_wheels(
    victim: str, number: signal.Signals, code: int, words: str, tmp_path: Path
) -> None:
    with Crew(router=True) as crew:
        robot = crew.robot("--mcu", "--lockstep")
        recorder = crew.dialling("rec", "start", str(tmp_path))
        until(lambda: list(tmp_path.glob("*.tlog")), within_s=SOON_S, what="a recording")
        crew.plant("--lockstep", "--speed", "1")
        with Witness(crew.endpoint) as witness:
            witness.ready()
            crew.dialling("goto", "5.4", "2")
            witness.driving()
            family = family_of(robot)
            signal_one(robot, victim, number)
            assert robot.ends(SOON_S) == code
            none_left(family)
            assert words in robot.said
            until(witness.standing, within_s=SOON_S, what="standing")
            seen = len(witness.truths)
            until(
                lambda: len(witness.truths) > seen + TICKS_AFTER, within_s=SOON_S, what="more truth"
            )
        recorder.send(signal.SIGINT)
        recorder.ends(SOON_S)
    messages = messages_in(tmp_path)
    stops_in_time(messages)
    assert words in texts_in(messages)


def stops_in_time(messages: list[Message]) -> None:
    """Require that the wheels stop in time after the last speeds, and stay stopped."""
    driven_ns = max(
        one.time_ns
        for one in messages
        if isinstance(one, WheelCommand) and (one.left_mrad_s or one.right_mrad_s)
    )
    truths = [one for one in messages if isinstance(one, GroundTruth)]
    limit_ns = driven_ns + (STOPPED_MS + PERIOD_MS) * MS
    after = [truth for truth in truths if truth.time_ns >= limit_ns]
    assert not all(is_still(truth) for truth in truths)
    assert len(after) >= TICKS_AFTER - (STOPPED_MS // PERIOD_MS) - 1
    assert all(is_still(truth) for truth in after)


def await_driving(up: Running) -> None:
    """Wait until a second of the drive is over; a busy machine prints no line in the first one."""
    until(
        lambda: (
            re.search(r"driving\b.* [1-9]\d* seconds?\b", up.said) or up.process.poll() is not None
        ),
        within_s=SOON_S,
        what=lambda: up.said,
    )


@pytest.mark.usefixtures("firmware")
def test_up_restarts_a_robot_on_a_fresh_board(tmp_path: Path) -> None:
    with Crew() as crew:
        up = crew.start(*UP, "--record", str(tmp_path))
        await_driving(up)
        signal_one(up, ROBOT, signal.SIGKILL)
        why = "the robot r1 process was killed (signal SIGKILL)"
        up.says(f"{why}; restarting", SOON_S)
        family = family_of(up)
        assert up.ends(SOON_S) == 1
        none_left(family)
        reason = json.loads(up.said.splitlines()[-1])["reason"]
    assert reason == f"no valid trial: {why}; it is back, but with a fresh state"
    assert "restarted: the previous run was killed" in texts_in(messages_in(tmp_path))


@pytest.mark.usefixtures("firmware")
def test_interrupted_up_leaves_no_emulator() -> None:
    with Crew() as crew:
        up = crew.start(*UP, "--no-record")
        await_driving(up)
        family = family_of(up)
        assert [pid for pid in family if EMULATOR in cmdline(pid)]
        up.send(signal.SIGINT)
        assert up.ends(SOON_S) == 130
        none_left(family)
        assert "Traceback" not in up.said


def test_up_without_an_emulator_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with Crew() as crew:
        up = crew.start(*UP, "--no-record")
        assert up.ends(SOON_S) == 2
        result = json.loads(up.said.splitlines()[-1])
    assert "qemu-system-arm not found: apt install qemu-system-arm" in result["reason"]
    assert result["exit_code"] == 2
