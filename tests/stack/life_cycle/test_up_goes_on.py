"""`up` when one of its processes dies: messages, exit code, and processes left."""

import json
import os
import shutil
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from ground.launch.scenario import CLOCKS, PACED
from ground.recording.log_reader import TlogReader
from protocol.wire.codec import decode
from protocol.wire.messages import Statustext
from tests.support.stack.process_table import ROOT, alive, children_of, cmdline, frames_in
from tests.support.stack.processes import Crew, Running, real_time
from tests.support.stack.tmux import Tmux
from tests.support.until import until

pytestmark = pytest.mark.stack

DRIVE_S = 60.0
SILENT_S = {"paced": "4.5", "wall": "2.5"}


class Up:
    """`up` under way, and the processes that it has started."""

    def __init__(self, running: Running) -> None:
        self.running = running

    @property
    def pids(self) -> list[int]:
        return children_of(self.running.process.pid)

    def pid(self, verb: str) -> int:
        (found,) = [pid for pid in self.pids if f" {verb} --" in words_of(pid)]
        return found

    def has(self, verb: str, other_than: int) -> bool:
        """Is there one of this verb that is another process?"""
        return any(f" {verb} --" in words_of(pid) for pid in self.pids if pid != other_than)

    def kill(self, verb: str) -> int:
        victim = self.pid(verb)
        os.kill(victim, signal.SIGKILL)
        return victim

    def says(self, words: str) -> None:
        self.running.says(words)

    def result(self) -> dict[str, object]:
        """Return the JSON object at the end; require that no process is left."""
        pids = self.pids
        self.running.ends(DRIVE_S)
        assert not [pid for pid in pids if alive(pid)]
        assert "Traceback" not in self.running.said
        (line,) = [line for line in self.running.said.splitlines() if line.startswith("{")]
        found: dict[str, object] = json.loads(line)
        return found


def words_of(pid: int) -> str:
    """Empty for one that has ended meanwhile."""
    try:
        return cmdline(pid)
    except (FileNotFoundError, ProcessLookupError):
        return ""


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Use the clock that is the default, and with `--examples long` each one."""
    if "clock" in metafunc.fixturenames:
        is_long = metafunc.config.getoption("--examples") == "long"
        metafunc.parametrize("clock", CLOCKS if is_long else [PACED])


@contextmanager
def under_way(*words: str) -> Iterator[Up]:
    """Start `up` headless; yield it once the robot drives."""
    with Crew() as crew:
        up = Up(crew.start("up", "--headless", "--world", "open", "--json", *words))
        up.says("driving")
        for pid in up.pids:
            real_time(pid)
        yield up


def test_without_its_robot_there_is_no_trial_but_the_other_one_goes_on(tmp_path: Path) -> None:
    with under_way("--robots", "2", "--goal", "1.8", "2", "--record", str(tmp_path)) as up:
        victim = next(pid for pid in up.pids if " robot --id r2 " in words_of(pid))
        os.kill(victim, signal.SIGKILL)
        why = "the robot r2 process was killed (signal SIGKILL)"
        up.says(f"{why}; restarting")
        found = up.result()
    assert found["ok"] is False
    back = "it is back, but with a fresh state"
    assert str(found["reason"]).startswith(f"no valid trial: {why}; {back}; r1 ")
    (log,) = tmp_path.glob("*-r2.tlog")
    assert "restarted: the previous run was killed (signal SIGKILL)" in texts_in(log)


def texts_in(log: Path) -> str:
    """Return all status texts of the robot, with their pieces joined."""
    with log.open("rb") as source:
        messages = [decode(record.frame).message for record in TlogReader(source)]
    return "".join(one.text for one in messages if isinstance(one, Statustext))


def test_without_its_router_the_robot_stops_by_itself_and_that_is_the_outcome() -> None:
    """Use wall time: the paced simulation would wait for the router."""
    with under_way("--router", "--clock", "wall") as up:
        up.kill("router")
        up.says("the router process was killed (signal SIGKILL); restarting")
        found = up.result()
    assert found["outcome"] == "aborted"


def test_a_recorder_that_dies_is_followed_by_another_one_and_the_robot_drives_on(
    tmp_path: Path,
) -> None:
    with under_way("--goal", "2", "2", "--record", str(tmp_path)) as up:
        (first,) = tmp_path.glob("*.tlog")
        up.kill(f"rec start {tmp_path}")
        up.says("the recorder r1 process was killed (signal SIGKILL); restarting")
        found = up.result()
        assert found["outcome"] == "reached"
    (second,) = set(tmp_path.glob("*.tlog")) - {first}
    second.rename(tmp_path / "elsewhere")
    assert frames_in(tmp_path) > 0
    assert (tmp_path / "elsewhere").stat().st_size > 2000


@pytest.mark.parametrize("born", [False, True])
def test_ctrl_c_while_one_is_started_again_leaves_nothing_behind(born: bool) -> None:
    with under_way() as up:
        before = up.pids
        victim = up.kill("robot")
        if born:
            until(lambda: up.has("robot", other_than=victim), what="the next one")
        after = up.pids
        up.running.send(signal.SIGINT)
        assert up.running.ends() == 130
        until(lambda: not [pid for pid in {*before, *after} if alive(pid)], what="nobody")
        assert "Traceback" not in up.running.said


@pytest.mark.skipif(shutil.which("tmux") is None, reason="no tmux on this machine")
def test_app_shows_which_process_was_restarted_and_why(clock: str, tmp_path: Path) -> None:
    words = [sys.executable, str(ROOT / "sidestep.py"), "up", "--clock", clock, "--world", "open"]
    words += ["--no-record"]
    with Tmux(tmp_path, words, (140, 30), {"COLUMNS": "140"}) as tmux:
        tmux.shows("read: ready")
        tmux.press("7")
        tmux.shows("end robot r1", "hang plant")
        tmux.press("j", "j", "s", "s", "4")
        tmux.shows(
            "the robot r1 process was killed (signal SIGKILL); restarting",
            "restarted: the previous run was killed (signal SIGKILL)",
            "r1 has been restarted (1)",
        )
        tmux.press("1")
        tmux.shows("DISARMED")
        tmux.press("7", "j", "s", "s", "4")
        tmux.shows(
            f"the plant process hung (silent for {SILENT_S[clock]} s); restarting",
            "position lost: sensor stream restarted",
            "the plant of r1 has been restarted (1)",
        )
        tmux.press("C-q", "C-q")
        assert tmux.ends() == 0


@pytest.mark.skipif(shutil.which("tmux") is None, reason="no tmux on this machine")
def test_app_changes_the_world_and_drives_without_a_loss(clock: str, tmp_path: Path) -> None:
    words = [sys.executable, str(ROOT / "sidestep.py"), "up", "--clock", clock, "--world", "box"]
    words += ["--no-record"]
    with Tmux(tmp_path, words, (140, 40), {"COLUMNS": "140"}) as tmux:
        tmux.shows("read: ready")
        tmux.press("6")
        tmux.shows("18 worlds", "shortest way")
        tmux.press("j", "j", "j")
        tmux.shows("One round obstacle", "disc  ")
        tmux.press("s", "s", "4")
        tmux.shows("disc: to (5.400, 2.000)")
        tmux.press("1")
        shown = tmux.shows("disc: to (5.400, 2.000)", "AUTO ▸ ARMED")
        assert not [words for words in ("DEAD", "HUNG", "LOST", "STALE") if words in shown]
        tmux.press("4")
        log = tmux.shows("vehicle ACTIVE", "read: ready")
        # A link that pauses for its lease of 1 s, because the machine is busy, is no loss.
        assert not [words for words in ("DEAD", "killed", "hung", "restarted") if words in log]
        tmux.press("C-q", "C-q")
        assert tmux.ends() == 0
