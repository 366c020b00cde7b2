"""MAVProxy: each step writes commands to its prompt and reads its output.

A second connection, to which MAVProxy forwards, shows the state of the vehicle. It only listens.
"""

import re
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from tests.interop.clients.pilot import Pilot
from tests.interop.clients.steps import (
    LONG_S,
    PARAMETER,
    PATIENCE_S,
    VALUE,
    Call,
    Place,
    StepError,
    Steps,
    called,
    fence,
    goal,
    pause,
    repeat,
    route,
    until,
)

MODULES: Final = "log,signing,wp,rally,fence,ftp,param,arm,mode,misc,cmdlong,output"
WAYPOINT: Final = 16
CORNER: Final = 5001
SHOWN: Final = 12
AGAIN_S: Final = 4.0


class MavProxy:
    """The process, its prompt and its output."""

    def __init__(self, call: Call) -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        script = Path(sys.executable).with_name("mavproxy.py")
        words = [sys.executable, "-u", str(script), f"--master={call.endpoint}"]
        words += [f"--out=udpout:127.0.0.1:{port}", f"--state-basedir={call.folder}"]
        words += [f"--default-modules={MODULES}", f"--logfile={call.folder / 'mav.tlog'}"]
        self.lines: list[str] = []
        self.observer = Pilot(f"udpin:127.0.0.1:{port}", is_silent=True)
        self._process = subprocess.Popen(
            words,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=call.folder,
        )
        threading.Thread(target=self._read, daemon=True).start()

    def type(self, *lines: str) -> None:
        """Type lines at the prompt."""
        assert self._process.stdin is not None
        for line in lines:
            self._process.stdin.write(line + "\n")
        self._process.stdin.flush()

    def printed(self, pattern: str, since: int = 0) -> re.Match[str] | None:
        """Return the last line that matches."""
        found = (re.search(pattern, line) for line in reversed(self.lines[since:]))
        return next((one for one in found if one), None)

    def until(
        self, condition: Callable[[], object], what: str, within_s: float = PATIENCE_S
    ) -> None:
        """Wait for a condition; a failure quotes the last lines of output."""
        self._quote(lambda: until(condition, what, within_s, self._look))

    def repeat(
        self,
        lines: Sequence[str],
        condition: Callable[[], object],
        what: str,
        within_s: float = LONG_S,
        every_s: float = AGAIN_S,
    ) -> None:
        """Type lines until a condition holds, at most every `every_s`."""
        self._quote(
            lambda: repeat(
                lambda: self.type(*lines),
                condition,
                what,
                every_s=every_s,
                within_s=within_s,
                look=self._look,
            )
        )

    def until_printed(self, lines: Sequence[str], pattern: str, every_s: float = AGAIN_S) -> None:
        """Type lines until something new is printed."""
        since = len(self.lines)
        self.repeat(
            lines, lambda: self.printed(pattern, since), f"output {pattern!r}", every_s=every_s
        )

    def end(self) -> None:
        """End the process, which at SIGTERM only waits for the next line at its prompt."""
        self._process.kill()
        self._process.wait()

    def _quote(self, wait: Callable[[], object]) -> None:
        try:
            wait()
        except StepError as error:
            raise StepError(f"{error}; {self.lines[-SHOWN:]}; {self.observer.seen()}") from None

    def _look(self) -> None:
        if self._process.poll() is not None:
            raise StepError(f"MAVProxy has ended: {self.lines[-SHOWN:]}")
        self.observer.look()
        pause()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.lines.append(line.rstrip())


def main() -> None:
    """Run the scenario."""
    call, steps = called(), Steps("MAVProxy")
    proxy = MavProxy(call)
    seen = proxy.observer
    try:
        proxy.until(lambda: proxy.printed("^Connect "), "its start")
        with steps.step("connect", is_needed=True):
            proxy.until(lambda: proxy.printed("Detected vehicle 1:1"), "a detected vehicle")
        prepare(proxy, steps, call)
        drive(proxy, steps, seen.place, call.folder)
        with steps.step("stop"):
            proxy.repeat(["long DO_FLIGHTTERMINATION 1"], lambda: seen.is_stopped, "EMERGENCY")
    finally:
        proxy.end()
    steps.end()


def prepare(proxy: MavProxy, steps: Steps, call: Call) -> None:
    """Do the steps before the robot is armed."""
    seen = proxy.observer
    with steps.step("parameters"):
        pattern = r"Received (\d+) parameters"
        proxy.until(lambda: proxy.printed(pattern), "all parameters", 40.0)
        found = proxy.printed(pattern)
        steps.note(found[0] if found else "")
    with steps.step("home"):
        proxy.until_printed(["status HOME_POSITION"], r"HOME_POSITION \{")
        proxy.until(lambda: "GLOBAL_POSITION_INT" in seen.newest, "a position")
    with steps.step("set_parameter"):
        lines = [f"param set {PARAMETER} {VALUE}", f"param fetch {PARAMETER}"]
        # The first answer may hold the older value.
        proxy.until_printed(lines, rf"{PARAMETER} = {VALUE}", every_s=1.0)
    with steps.step("fence"):
        path = waypoint_file(call.folder / "fence.txt", fence(seen.place), CORNER, 4)
        proxy.until_printed([f"fence load {path}"], "Got MISSION_ACK: .*FENCE.*: .*ACCEPTED")
    with steps.step("log"):
        path = call.folder / "downloaded.tlog"
        proxy.until_printed(["log list"], "^Log 1 ")
        # MAVProxy does not repeat its first request.
        lines, done = [f"log download 1 {path}"], "Finished downloading"
        proxy.repeat(lines, lambda: proxy.printed(done), "the log", 50.0, every_s=9.0)
        call.require_recording(path)


def drive(proxy: MavProxy, steps: Steps, start: Place, folder: Path) -> None:
    """Do the steps in which the robot drives."""
    seen = proxy.observer
    places, there = route(start), goal(start)
    with steps.step("upload"):
        path = waypoint_file(folder / "mission.txt", [start, *places], WAYPOINT)
        proxy.until_printed([f"wp load {path}"], "Got MISSION_ACK: .*MISSION: .*ACCEPTED")
    with steps.step("start"):
        proxy.repeat(["arm throttle"], lambda: seen.is_armed, "armed")
        proxy.repeat(["mode AUTO"], lambda: seen.mode == "AUTO", "mode AUTO")
        proxy.until(lambda: seen.place.distance_m(start) > 0.3, "30 cm of the way")
    with steps.step("pause"):
        proxy.repeat(["mode HOLD"], lambda: seen.mode == "HOLD", "mode HOLD")
        proxy.until(lambda: seen.speed_m_s < 0.01, "a standing robot")
        if seen.is_at(places[-1]):
            raise StepError("the mission was over before the pause")
    with steps.step("complete"):
        # The mode that is seen may be that before the pause: a lossy line reorders.
        proxy.repeat(["mode AUTO"], lambda: seen.is_at(places[-1]), "the last waypoint", 50.0)
    with steps.step("goto"):
        lines = [f"guided {there.latitude:.7f} {there.longitude:.7f} 0"]
        proxy.repeat(lines, lambda: seen.is_at(there), "the place", 50.0, every_s=6.0)
    with steps.step("mode"):
        since = len(proxy.lines)
        proxy.repeat(["mode HOLD"], lambda: proxy.printed("Mode HOLD", since), "mode HOLD")


def waypoint_file(path: Path, places: Sequence[Place], command: int, param1: int = 0) -> Path:
    """Write a file of waypoints as ground stations have it."""
    rows = ["QGC WPL 110"]
    for seq, place in enumerate(places):
        words = (seq, 0, 3, command, param1, 0, 0, 0, f"{place[0]:.8f}", f"{place[1]:.8f}", 0, 1)
        rows.append("\t".join(str(word) for word in words))
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


if __name__ == "__main__":
    main()
