"""Further ways of an emergency stop to its robot, each sufficient alone, beside the open session.

Datagrams need no session; a fresh session replaces one that is cut off without showing it; and a
program that has just been started uses the open sessions of others on this machine.
"""

import asyncio
import json
import os
import socket
import stat
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from hashlib import sha256
from pathlib import Path
from threading import Event, Lock, Thread
from typing import Final

import msgspec

from ground.client.connection import Common
from ground.client.emergency_stop import NO_WAYS, REPEAT_NS, EmergencyStop, StopOutcome, StopWays
from ground.client.requests import GaveUp
from ground.client.robot_link import RobotLink, open_link
from ground.client.stop_datagrams import StopDatagrams
from ground.user.folders import runs_folder
from protocol.bus.network import Network
from protocol.topic import ROBOT_NAME
from protocol.topics import COMMAND, STATUS, STOP
from runtime.errors import RemoteError, UserError
from runtime.files import make_folder
from runtime.units import NS_PER_S

NEW_SESSION: Final = "by a new session"
FRESH: Final = "stop of its own"
"""Name of the threads that the interpreter waits for at its end."""

FOLDER: Final = "stops"
"""Below the folder of the runs; its sockets can be used by this user only."""

ENDING: Final = ".sock"
MOST_BYTES: Final = 200
REQUEST_S: Final = 1.0
"""A request on a local socket arrives at once; a peer that is silent for so long is no `estop`."""

LONGEST_S: Final = 60.0
"""Limit of the datagrams of one press, should whoever repeats it hang."""

ANSWER_S: Final = 10.0
MOST_REPEATED: Final = 16
"""Stops for others that are repeated at the same time; further ones are sent once."""


class SideWays:
    """The further ways to one robot; its owner closes it.

    `common` has the network that is dialled; `holder` is the name in the own certificate. Unless it
    `opens` fresh sessions, another part does.
    """

    def __init__(self, common: Common, holder: str | None, *, opens: bool = True) -> None:
        self._common, self._opens = common, opens
        self._datagrams = StopDatagrams(common.network, common.robot, holder)
        self._others = OpenSessions(common)
        self._fresh: FreshSession | None = None
        self._closing = Event()
        self._lock = Lock()
        self._repeated = 0
        self._repeating: Thread | None = None

    @property
    def why(self) -> str:
        """Why the datagrams cannot be sent; empty if they can."""
        return self._datagrams.why

    def press(self, request_id: int) -> None:
        """Send a stop by datagrams, without blocking, and repeat it until it is answered or ended.

        The repetition has a thread of its own: the one that presses may be held up by the bus. If
        this system can make no thread now, the next `press` sends the next datagram.
        """
        if request_id == self._repeated or self._datagrams.has_stopped(request_id):
            return
        self._datagrams.press(request_id)
        with self._lock:
            if self._repeating is None:
                self._repeating = Thread(target=self._repeat, name="stop datagrams", daemon=True)
                try:
                    self._repeating.start()
                except RuntimeError:
                    self._repeating = None
                    return
            self._repeated = request_id

    def _repeat(self) -> None:
        """Repeat the newest press; one that is answered must not outlive a later clear."""
        request_id, until_s = 0, 0.0
        while not self._closing.wait(REPEAT_NS / NS_PER_S):
            with self._lock:
                if self._repeated != request_id:
                    request_id, until_s = self._repeated, time.monotonic() + LONGEST_S
                elif self._datagrams.has_stopped(request_id) or time.monotonic() > until_s:
                    request_id = self._repeated = 0
                if not request_id:
                    self._repeating = None
                    return
            self._datagrams.press(request_id)

    @property
    def others_why(self) -> str:
        """Why no other program on this computer is asked; empty if each is."""
        return self._others.why

    def ask_others(self, request_id: int) -> None:
        """Let the programs on this machine that have an open session send the stop."""
        self._others.press(request_id)

    def open_session(self, request_id: int, give_up_ns: int) -> "FreshSession | None":
        """Open a session with an id of its own, and stop by it; one for each request."""
        if not self._opens:
            return None
        if self._fresh is None or self._fresh.request_id != request_id:
            if self._fresh is not None:
                self._fresh.close()
            self._fresh = FreshSession(self._common, request_id, give_up_ns)
        return self._fresh

    def stopped_by(self, request_id: int) -> str:
        """Return by which way the robot has acknowledged a stop; empty if by none."""
        if self._datagrams.has_stopped(request_id):
            return "by datagram"
        if self._fresh is not None and self._fresh.has_stopped(request_id):
            return NEW_SESSION
        return self._others.stopped_by(request_id)

    def end_session(self) -> None:
        """End the repetition and the session opened for a stop, so that they stop nothing later."""
        with self._lock:
            self._repeated = 0
        if self._fresh is not None:
            self._fresh.close()

    def close(self) -> None:
        """End what is still under way."""
        self._closing.set()
        self.end_session()
        self._others.close()
        self._datagrams.close()


def ways_of(bus: object, robot: str) -> StopWays:
    """Return the further ways to a robot, beside an open bus; none beside one that is played."""
    network, holder = getattr(bus, "network", None), getattr(bus, "holder", None)
    if not isinstance(network, Network) or not (network.connect or robot in network.stop_at):
        return NO_WAYS
    return SideWays(Common(network=network, robot=robot), holder)


class FreshSession:
    """Stops a robot by a session that it opens in a thread of its own.

    `error` is why it could not; None while it is under way, and after success.
    """

    def __init__(self, common: Common, request_id: int, give_up_ns: int) -> None:
        self.error: Exception | None = None
        self.outcome: StopOutcome | None = None
        self.is_over = False
        self.request_id = request_id
        self._closing = Event()
        # No daemon: the interpreter must not end in the middle of a call of Zenoh.
        self._thread = Thread(target=self._run, args=(common, give_up_ns), name=FRESH)
        self._thread.start()

    def has_stopped(self, request_id: int) -> bool:
        """Return whether the robot has acknowledged this stop."""
        outcome = self.outcome
        return request_id == self.request_id and outcome is not None and outcome.acknowledged

    def close(self) -> None:
        """Let the thread end; one that still dials is not awaited."""
        self._closing.set()

    def _run(self, common: Common, give_up_ns: int) -> None:
        try:
            with open_link(common) as link:
                self.outcome = stop_by(link, self.request_id, give_up_ns, self._closing.is_set)
        except Exception as error:
            self.error = error
        finally:
            self.is_over = True


def stop_by(
    link: RobotLink, request_id: int, give_up_ns: int, is_over: Callable[[], bool]
) -> StopOutcome:
    """Repeat a stop by an open session only; UnansweredError if the robot sends no status."""
    with link.subscribed(STATUS) as telemetry:
        publisher = link.bus.publisher(STOP, link.name)
        stop = EmergencyStop(
            link.bus,
            publisher,
            link.name,
            link.clock,
            lambda: telemetry.latest(STATUS),
            request_id=request_id,
        )
        outcome = stop.run(is_over, give_up_ns)
        if telemetry.latest(STATUS) is None and not outcome.acknowledged and not is_over():
            raise asyncio.run(link.unanswered(GaveUp(outcome.why), COMMAND))
        return outcome


# Local sockets.


class StopWanted(msgspec.Struct, frozen=True, kw_only=True):
    """The line that `estop` writes: which robot is to stop, and the id of its request."""

    robot: str
    request_id: int


class StopDone(msgspec.Struct, frozen=True, kw_only=True):
    """The line that answers it."""

    acknowledged: bool


def socket_folder() -> Path:
    """Return the folder of the local sockets."""
    return runs_folder() / FOLDER


def stem_of(common: Common) -> str:
    """Return what the sockets of all programs begin with that are linked to the same bus."""
    host = socket.gethostname()  # a home may be on several
    words = json.dumps([sorted(common.network.connect), common.network.prefix, host])
    return sha256(words.encode()).hexdigest()[:16]


def distrust(folder: Path) -> str:
    """Return why the sockets in a folder may be those of another user; empty if they are not.

    What answers there is believed when it says that a robot has stopped.
    """
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.geteuid():
        return f"{folder} is not a folder of this user: remove it"
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return f"others may write to {folder}: `chmod 700` it, after removing what is in it"
    return ""


@contextmanager
def near(folder: Path) -> Iterator[str]:
    """Yield a short path to a folder: that of a local socket has at most 107 bytes."""
    number = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        short = f"/proc/self/fd/{number}"
        yield short if os.path.isdir(short) else str(folder)
    finally:
        os.close(number)


class OpenSessions:
    """Asks every program on this machine that is linked to the same bus to stop a robot."""

    def __init__(self, common: Common) -> None:
        self.why = ""
        self._stem, self._robot = stem_of(common), common.robot
        self._stopped: dict[int, str] = {}
        self._lock = Lock()
        self._open: set[socket.socket] = set()

    def press(self, request_id: int) -> None:
        """Ask each, in a thread of its own; a socket whose program has ended is removed."""
        folder = socket_folder()
        try:
            self.why = distrust(folder)
        except FileNotFoundError:
            return  # no program has made it
        except OSError as error:
            self.why = str(error)
        for path in () if self.why else sorted(folder.glob(f"{self._stem}.*{ENDING}")):
            Thread(target=self._ask, args=(path, request_id), daemon=True).start()

    def stopped_by(self, request_id: int) -> str:
        """Return which program has stopped the robot; empty if none."""
        return self._stopped.get(request_id, "")

    def close(self) -> None:
        """End all questions."""
        with self._lock:
            for asked in self._open:
                with suppress(OSError):
                    asked.shutdown(socket.SHUT_RDWR)

    def _ask(self, path: Path, request_id: int) -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as asked:
            with self._lock:
                self._open.add(asked)
            try:
                asked.settimeout(ANSWER_S)
                with near(path.parent) as folder:
                    asked.connect(f"{folder}/{path.name}")
                wanted = StopWanted(robot=self._robot, request_id=request_id)
                asked.sendall(msgspec.json.encode(wanted) + b"\n")
                if msgspec.json.decode(line_from(asked), type=StopDone).acknowledged:
                    self._stopped[request_id] = f"by the session of process {path.stem[17:]}"
            except ConnectionRefusedError:
                with suppress(OSError):
                    path.unlink()
            except (OSError, ValueError):
                pass  # another way has to do
            finally:
                with self._lock:
                    self._open.discard(asked)


def line_from(opened: socket.socket) -> bytes:
    """Return the first line that arrives; empty if it is too long or the peer has ended."""
    found = b""
    while b"\n" not in found and len(found) < MOST_BYTES:
        if not (more := opened.recv(MOST_BYTES)):
            break
        found += more
    return found.partition(b"\n")[0]


class StopServer:
    """Lets `estop` on this machine use the open session of this program, best by `with`.

    It listens on a socket of this user. Without one (`why`) the program works as before.
    """

    def __init__(self, link: RobotLink) -> None:
        self.why = ""
        self._link = link
        self._closing = Event()
        self._repeated = 0
        self._path: Path | None = None
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            folder = socket_folder()
            make_folder(folder.parent)
            with suppress(FileExistsError):
                folder.mkdir(stat.S_IRWXU)
            if why := distrust(folder):
                raise UserError(why)
            path = folder / f"{stem_of(link.common)}.{os.getpid()}{ENDING}"
            draft = path.with_suffix(".part")
            draft.unlink(missing_ok=True)
            with near(folder) as short:
                self._listener.bind(f"{short}/{draft.name}")
            draft.chmod(stat.S_IRUSR | stat.S_IWUSR)
            self._listener.listen(MOST_REPEATED)
            draft.replace(path)  # now that it answers: one that does not is removed
        except (OSError, UserError) as error:
            self.why = f"`estop` cannot use this session: {error}"
            self._listener.close()
            return
        self._path = path
        self._thread = Thread(target=self._serve, name="stops of others", daemon=True)
        self._thread.start()

    def __enter__(self) -> "StopServer":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Remove the socket and end the thread."""
        if self._path is None:
            return
        self._closing.set()
        with suppress(OSError):
            self._path.unlink()
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        self._listener.close()

    def _serve(self) -> None:
        while not self._closing.is_set():
            try:
                asking, _ = self._listener.accept()
            except OSError:
                if self._closing.wait(0.1):
                    return
                continue
            Thread(target=self._answer, args=(asking,), name=FRESH).start()

    def _answer(self, asking: socket.socket) -> None:
        with asking, suppress(OSError, ValueError, RemoteError):
            asking.settimeout(REQUEST_S)
            wanted = msgspec.json.decode(line_from(asking), type=StopWanted)
            if not ROBOT_NAME.match(wanted.robot):
                return
            outcome = self._stop(self._link.to(wanted.robot), wanted.request_id)
            done = StopDone(acknowledged=outcome is not None and outcome.acknowledged)
            asking.sendall(msgspec.json.encode(done) + b"\n")

    def _stop(self, link: RobotLink, request_id: int) -> StopOutcome | None:
        give_up_ns = round(ANSWER_S * NS_PER_S)
        if self._repeated >= MOST_REPEATED:
            give_up_ns = 0
        self._repeated += 1
        try:
            return stop_by(link, request_id, give_up_ns, self._closing.is_set)
        finally:
            self._repeated -= 1
