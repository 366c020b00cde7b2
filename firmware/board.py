"""A board on a serial line, or emulated by qemu: its set-up, requests, ticks and frames.

Frames are found in the stream of bytes without I/O. Bytes that belong to no frame are skipped. An
incomplete frame is skipped as soon as a whole frame follows its start, so that a damaged length
never blocks the stream.
"""

import ctypes
import os
import select
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from types import TracebackType
from typing import Final, NamedTuple, Self, TypeAlias, TypeVar, cast

from firmware.image import IMAGE, core_hash, core_version
from protocol.wire import messages as wire
from protocol.wire.codec import HEADER_SIZE, MAGIC_BYTE, OUTSIDE, WIRE_OF_ID, Encoder, decode
from protocol.wire.enums import ResetCause
from protocol.wire.message import LAYOUT, Message
from protocol.wire.reasons import reason_text
from robot.core.parameters import DEFAULTS, Params
from robot.core.values import Pose
from runtime.errors import RemoteError, UserError


class FrameStream:
    """Collects bytes and returns whole messages; `skipped` counts the bytes of no frame."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self.skipped = 0

    @property
    def waiting(self) -> int:
        """Bytes of an incomplete frame."""
        return len(self._bytes)

    def feed(self, received: bytes) -> Iterator[Message]:
        """Yield the messages that these bytes complete."""
        self._bytes += received
        start = self._bytes.find(MAGIC_BYTE)
        while start >= 0:
            message, size = self._message_at(start)
            if message is None:
                start = self._bytes.find(MAGIC_BYTE, start + 1)
                continue
            self._skip(start)
            del self._bytes[:size]
            yield message
            start = self._bytes.find(MAGIC_BYTE)
        self._skip(self._first_unfinished())

    def _message_at(self, start: int) -> tuple[Message | None, int]:
        """Return the message and the size of a frame; no message if it is incomplete or invalid."""
        size = self._size_at(start)
        if size == 0 or start + size > len(self._bytes):
            return None, size
        try:
            return decode(bytes(self._bytes[start : start + size])).message, size
        except RemoteError:
            return None, size

    def _size_at(self, start: int) -> int:
        """Return the size of a frame by its header; 0 if the header has not arrived."""
        return self._bytes[start + 1] + OUTSIDE if start + 1 < len(self._bytes) else 0

    def _first_unfinished(self) -> int:
        """Return the first place at which a frame may begin whose rest has not arrived."""
        start = self._bytes.find(MAGIC_BYTE)
        while start >= 0:
            size = self._size_at(start)
            is_incomplete = size == 0 or start + size > len(self._bytes)
            if is_incomplete and is_possible(self._bytes[start : start + HEADER_SIZE]):
                return start
            start = self._bytes.find(MAGIC_BYTE, start + 1)
        return len(self._bytes)

    def _skip(self, count: int) -> None:
        self.skipped += count
        del self._bytes[:count]


def is_possible(header: bytearray) -> bool:
    """Return whether a header, perhaps a part of one, can begin a frame of the dialect."""
    if len(header) < HEADER_SIZE:
        return True
    wire = WIRE_OF_ID.get(int.from_bytes(header[7:10], "little"))
    return wire is not None and header[2] == 0 and 0 < header[1] <= wire.size


QEMU: Final = "qemu-system-arm"
MACHINE: Final = "mps2-an385"
INSTRUCTION_SHIFT: Final = 5
"""32 ns: three cycles an instruction at 96 MHz, by which the board's own clock is realistic."""
PR_SET_PDEATHSIG: Final = 1
READ_BYTES: Final = 65_536
LOOK_S: Final = 0.25
"""Interval at which a wait checks that the emulator still runs."""


class SerialLine:
    """A line as two file descriptors, of which one is read and the other one written.

    `is_alive` returns whether the board at the other end still runs.
    """

    def __init__(self, reads: int, writes: int, is_alive: Callable[[], bool]) -> None:
        self._reads, self._writes = reads, writes
        self._is_alive = is_alive

    def read(self, wait_s: float) -> bytes | None:
        """Return the bytes that have arrived; nothing within this time: b"", line cut: None."""
        deadline = monotonic() + wait_s
        while True:
            left_s = max(0.0, deadline - monotonic())
            if select.select([self._reads], [], [], min(left_s, LOOK_S))[0]:
                return os.read(self._reads, READ_BYTES) or None
            if not self._is_alive():
                return None
            if left_s == 0.0:
                return b""

    def write(self, data: bytes) -> None:
        """Write bytes; raise OSError if the line is cut."""
        while data:
            data = data[os.write(self._writes, data) :]

    def close(self) -> None:
        """Cut the line."""
        os.close(self._reads)
        os.close(self._writes)


class Emulator:
    """A running qemu; `line` is the host's end of the serial line."""

    def __init__(self, image: Path, *, extra: Sequence[str] = ()) -> None:
        """Start qemu with an image."""
        if shutil.which(QEMU) is None:
            raise UserError(f"{QEMU} not found: apt install qemu-system-arm")
        if not image.exists():
            raise UserError(f"no firmware at {image}: build it with `make firmware`")
        self._folder = tempfile.TemporaryDirectory(prefix="sidestep-board-")
        pipes = [Path(self._folder.name) / f"line.{end}" for end in ("out", "in")]
        for pipe in pipes:
            os.mkfifo(pipe, mode=0o600)
        self._process = subprocess.Popen(
            command(image, pipes[0].with_suffix(""), extra),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            preexec_fn=end_with_parent,
        )
        # Opened for both directions, so that this does not wait for qemu.
        reads, writes = (os.open(pipe, os.O_RDWR) for pipe in pipes)
        self.line = SerialLine(reads, writes, self.is_running)

    @property
    def pid(self) -> int:
        """Process id of qemu."""
        return self._process.pid

    def is_running(self) -> bool:
        """Return whether qemu still runs."""
        return self._process.poll() is None

    def failure(self) -> str:
        """Return the first line of the error output of a qemu that has ended; empty if it runs."""
        assert self._process.stderr is not None
        if self.is_running():
            return ""
        return self._process.stderr.read().decode(errors="replace").strip().partition("\n")[0]

    def terminate(self) -> None:
        """End qemu normally, so that a plugin writes its results."""
        self._process.terminate()
        self._process.wait()

    def kill(self) -> None:
        """End qemu at once, as if the board had lost its power."""
        self._process.kill()
        self._process.wait()

    def close(self) -> None:
        """End qemu and cut the line."""
        self.kill()
        self.line.close()
        if self._process.stderr is not None:
            self._process.stderr.close()
        self._folder.cleanup()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: TracebackType | None,
    ) -> None:
        self.close()


def command(image: Path, line: Path, extra: Sequence[str]) -> list[str]:
    """Return the command line of qemu; `line` is the path of its pipes without their suffix."""
    return [
        QEMU,
        *("-machine", MACHINE),
        *("-display", "none"),
        *("-monitor", "none"),
        *("-icount", f"shift={INSTRUCTION_SHIFT}"),
        *("-kernel", str(image)),
        *("-chardev", f"pipe,id=line,path={line}"),
        *("-serial", "chardev:line"),
        *("-serial", "null"),
        *extra,
    ]


def end_with_parent() -> None:
    """Let the kernel end this child when its parent ends."""
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


Request: TypeAlias = (
    wire.BoardGoal
    | wire.BoardCommand
    | wire.BoardStop
    | wire.BoardParameter
    | wire.BoardFence
    | wire.BoardSetup
)
Expected = TypeVar("Expected", bound=Message)

HOST_SYSTEM: Final = 1
HOST_COMPONENT: Final = 191
PATIENCE_S: Final = 10.0
"""Longest wait for an answer: a busy machine emulates slowly."""
SILENCE_MS: Final = 60_000
"""The board stops the wheels after this time without a tick, unless the host chooses another."""
RESTART: Final = LAYOUT["BoardRestart"].number
PARAMETERS: Final = tuple(DEFAULTS._fields)


class BoardError(RemoteError):
    """The board is silent or has restarted, or the line to it is cut. Exit code 1."""

    exit_code = 1


class BoardMismatchError(UserError):
    """The image on the board was built from another core."""


class BoardOutputs(NamedTuple):
    """Outputs of a tick; `decision` is None if the core failed in it."""

    command: wire.WheelCommand
    odometry: wire.PlanarOdometry
    decision: wire.AvoidanceDecision | None
    state: wire.BoardState
    report: wire.BoardReport


class Board:
    """A board at the other end of a serial line."""

    def __init__(self, line: SerialLine, patience_s: float = PATIENCE_S) -> None:
        self._line = line
        self.patience_s = patience_s
        self._stream = FrameStream()
        self._arrived: list[Message] = []
        self._encoder = Encoder(HOST_SYSTEM, HOST_COMPONENT)
        self._sent: tuple[int, int] = (-1, -1)
        self._requests = 0
        self._hello: wire.BoardHello | None = None
        self._is_set_up = False
        self.state: wire.BoardState | None = None

    @classmethod
    @contextmanager
    def emulated(cls, image: Path = IMAGE.elf) -> Iterator[Self]:
        """Start an emulated board and wait for its BOARD_HELLO.

        Raises UserError without an emulator or a usable image, and BoardMismatchError for an image
        of another core.
        """
        with Emulator(image) as emulator:
            board = cls(emulator.line)
            try:
                board.wait_for_hello()
            except BoardError:
                if why := emulator.failure():
                    words = f"{image} cannot be run: build it again with `make firmware` ({why})"
                    raise UserError(words) from None
                raise
            yield board

    @property
    def hello(self) -> wire.BoardHello:
        """The newest BOARD_HELLO."""
        assert self._hello is not None
        return self._hello

    @property
    def skipped_bytes(self) -> int:
        """Bytes received that belong to no frame."""
        return self._stream.skipped

    def wait_for_hello(self) -> wire.BoardHello:
        """Wait for BOARD_HELLO; raise BoardMismatchError for an image of another core."""
        self._is_set_up = False
        hello = self._await(wire.BoardHello)
        self._requests = 0
        self._sent = (-1, -1)
        refuse_other_core(hello)
        return hello

    def set_up(
        self,
        params: Params,
        start: Pose = Pose(0.0, 0.0, 0.0),  # noqa: B008
        totals: tuple[int, int] = (0, 0),
        *,
        silence_ms: int = SILENCE_MS,
        fence_lost: bool = False,
    ) -> None:
        """Create the core on the board; raise UserError for a parameter that it refuses."""
        for name, value in differing(params).items():
            self._do(wire.BoardParameter(index=PARAMETERS.index(name), value=value), name)
        x_m, y_m, heading_rad = start
        left, right = totals
        setup = wire.BoardSetup(
            x_m=x_m,
            y_m=y_m,
            heading_rad=heading_rad,
            left=left,
            right=right,
            silence_ms=silence_ms,
            fence_lost=int(fence_lost),
        )
        self._do(setup, "set-up")
        self._is_set_up = True

    def request(self, request: Request) -> int:
        """Send a request and return the reason in its answer, 0 if done."""
        self.send(request)
        self._requests += 1
        answer = self._await(wire.BoardAnswer)
        if answer.request != self._requests:
            raise BoardError(f"the board answered request {answer.request}, not {self._requests}")
        if self.state is not None or (isinstance(request, wire.BoardSetup) and not answer.reason):
            self._await(wire.BoardState)
        return answer.reason

    def tick(
        self, inputs: wire.TickInputs, wheels: wire.WheelTicks | None, scan: wire.SonarScan | None
    ) -> BoardOutputs:
        """Run one tick; a sample that the board already has is not sent again."""
        seen = (-1 if wheels is None else wheels.seq, -1 if scan is None else scan.seq)
        fresh: list[Message] = []
        if wheels is not None and seen[0] != self._sent[0]:
            fresh.append(wheels)
        if scan is not None and seen[1] != self._sent[1]:
            fresh.append(scan)
        self._sent = seen
        self.send(*fresh, inputs)
        return self._outputs(inputs.tick)

    def restart(self) -> wire.BoardHello:
        """Reset the board and wait for its BOARD_HELLO."""
        self.send(wire.BoardRestart(confirmation=RESTART))
        self.state = None
        return self.wait_for_hello()

    def send(self, *messages: Message) -> None:
        """Send messages without waiting for an answer."""
        self.write(b"".join(self._encoder.encode(message) for message in messages))

    def write(self, frames: bytes) -> None:
        """Write bytes to the line."""
        try:
            self._line.write(frames)
        except OSError as error:
            raise BoardError(f"the line to the board is broken: {error.strerror}") from error

    def poll(self, wait_s: float = 0.0) -> list[Message]:
        """Return the messages that have arrived, after waiting at most `wait_s` for the first."""
        if not self._arrived:
            self._receive(monotonic() + wait_s)
        arrived, self._arrived = self._arrived, []
        return arrived

    def _outputs(self, tick: int) -> BoardOutputs:
        """Return the newest of each output up to the report of a tick."""
        newest: dict[type[Message], Message] = {}
        deadline = monotonic() + self.patience_s
        while wire.BoardReport not in newest:
            message = self._next(deadline)
            newest[type(message)] = message
        report = newest[wire.BoardReport]
        needed = (wire.WheelCommand, wire.PlanarOdometry, wire.BoardState)
        lost = [kind.__name__ for kind in needed if kind not in newest]
        if lost or not isinstance(report, wire.BoardReport) or report.tick != tick:
            raise BoardError(f"outputs of tick {tick} are lost: {', '.join(lost) or 'all'}")
        decision = newest.get(wire.AvoidanceDecision)
        return BoardOutputs(
            cast(wire.WheelCommand, newest[wire.WheelCommand]),
            cast(wire.PlanarOdometry, newest[wire.PlanarOdometry]),
            cast(wire.AvoidanceDecision | None, decision),
            cast(wire.BoardState, newest[wire.BoardState]),
            report,
        )

    def _do(self, request: Request, what: str) -> None:
        reason = self.request(request)
        if reason:
            raise UserError(f"the board refuses {what}: {reason_text(reason)}")

    def _await(self, kind: type[Expected]) -> Expected:
        """Return the next message of this kind; skip all others."""
        deadline = monotonic() + self.patience_s
        while True:
            message = self._next(deadline)
            if isinstance(message, kind):
                return message

    def _next(self, deadline: float) -> Message:
        """Return the next message; a BOARD_HELLO after the set-up raises BoardError."""
        while not self._arrived:
            if not self._receive(deadline):
                why = f"no answer for {self.patience_s:g} s"
                raise BoardError(f"the board hangs or its line is stuck: {why}")
        if self._is_set_up and isinstance(self._arrived[0], wire.BoardHello):
            raise restarted(self._arrived[0])
        return self._arrived.pop(0)

    def _receive(self, deadline: float) -> bool:
        """Wait for bytes; return False if none arrived before the deadline."""
        try:
            received = self._line.read(deadline - monotonic())
        except OSError as error:
            raise BoardError(f"the line to the board is broken: {error.strerror}") from error
        if received is None:
            raise BoardError("the line to the board is cut, or its emulator has ended")
        if not received:
            return False
        for message in self._stream.feed(received):
            self._note(message)
            self._arrived.append(message)
        return True

    def _note(self, message: Message) -> None:
        if isinstance(message, wire.BoardHello):
            self._hello = message
        elif isinstance(message, wire.BoardState):
            self.state = message


def restarted(hello: wire.BoardHello) -> BoardError:
    """Return the error of a board that sends BOARD_HELLO after its set-up."""
    cause = ResetCause(hello.reset_cause).name.lower()
    return BoardError(f"the board has restarted (cause: {cause})")


def differing(params: Params) -> Mapping[str, float]:
    """Return the parameters that differ from the defaults."""
    pairs = zip(PARAMETERS, params, DEFAULTS, strict=True)
    return {name: float(value) for name, value, default in pairs if value != default}


def refuse_other_core(hello: wire.BoardHello) -> None:
    """Raise BoardMismatchError unless the image was built from the core of this tree."""
    ours, theirs = core_hash(), bytes(hello.core_hash)
    if theirs != ours:
        raise BoardMismatchError(
            f"the board runs core {hello.core_version} ({theirs.hex()[:12]}), this is "
            f"{core_version()} ({ours.hex()[:12]}): build its image again with `make firmware`"
        )
