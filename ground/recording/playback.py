"""Play a recording through the interface of a bus, on a timeline that stops or moves at a speed.

The caller polls `advance`; frames are delivered in the caller's thread. Requests to the robot fail:
only recorded facts are answered.
"""

import json
from bisect import bisect_right
from collections.abc import Callable
from math import isfinite
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

from ground.client.parameter_rows import rows_in
from ground.recording.log_reader import LogIndex, open_log
from ground.recording.summary import Bookmark, marks_in
from protocol.bus.mailbox import Mailbox, Sample
from protocol.topics import (
    ANSWERED,
    DRIVE,
    ENCODING,
    HEARTBEAT,
    OPERATOR,
    PARAMETERS,
    STATUS,
    TOPICS,
    WHEELS,
    WORLD,
    Role,
    Service,
    Topic,
    key_parts,
    path_of,
)
from protocol.wire.message import Message
from protocol.wire.messages import ParamValue
from runtime.clock import Clock
from runtime.errors import LocalError, NoAnswerError, UserError
from runtime.units import NS_PER_S

SLOWEST: Final = 0.0625
FASTEST: Final = 64.0


class Timeline:
    """`position_ns` counts from the first frame; `now_ns` is the same instant in UTC."""

    def __init__(self, clock: Clock, start_ns: int, duration_ns: int) -> None:
        self._clock = clock
        self._start_ns = start_ns
        self.duration_ns = duration_ns
        self.speed = 1.0
        self.playing = False
        self._anchor_ns = 0
        self._since_ns = 0

    @property
    def position_ns(self) -> int:
        """Position in ns; playing stops at the end."""
        if not self.playing:
            return self._anchor_ns
        passed_ns = self._clock.now_ns() - self._since_ns
        position_ns = self.clamped(self._anchor_ns + round(passed_ns * self.speed))
        if position_ns >= self.duration_ns:
            self._anchor_ns, self.playing = self.duration_ns, False
        return position_ns

    @property
    def position_s(self) -> float:
        """Position in s."""
        return self.position_ns / NS_PER_S

    def play(self, speed: float | None = None) -> None:
        """Play from the present position; the speed is limited to the supported range."""
        self.move_to(self.position_ns)
        if speed is not None:
            self.speed = min(max(speed, SLOWEST), FASTEST)
        self.playing = True

    def pause(self) -> None:
        """Stop at the present position."""
        self.move_to(self.position_ns)
        self.playing = False

    def move_to(self, position_ns: int) -> None:
        """Move to a position in ns."""
        self._anchor_ns = self.clamped(position_ns)
        self._since_ns = self._clock.now_ns()

    def clamped(self, position_ns: int) -> int:
        """Return the nearest position inside the recording."""
        return min(max(position_ns, 0), self.duration_ns)

    def now_ns(self) -> int:
        """Return the position in UTC."""
        return self._start_ns + self.position_ns

    def cpu_ns(self) -> int:
        """Return the processor time of the real clock."""
        return self._clock.cpu_ns()

    def sleep_until(self, deadline_ns: int) -> None:
        """Return at once: a recording is polled."""


M = TypeVar("M", bound=Message)
Handler = Callable[[str, bytes, int], None]
PRESENCE_NS: Final = 3 * NS_PER_S
SLICE_NS: Final = NS_PER_S // 5
WHOLE_NS: Final = 60 * NS_PER_S
MAX_SLICES: Final = 1000
PRESENCE_TOPICS: Final = ((Role.ROBOT, HEARTBEAT), (Role.PLANT, WHEELS), (Role.GROUND, OPERATOR))
EVENTS: Final = frozenset(topic.path for topic in TOPICS if not topic.rate_hz)
RECORDED: Final = {WORLD.path: "world", PARAMETERS.path: "parameters"}


class RecordedPeer(NamedTuple):
    """A process that sent a message shortly before the present position of the recording."""

    robot: str
    role: str
    zid: str = "recording"


class ReplayBus:
    """Plays one recording. `clock` is the real one; `timeline` is the clock of the subscribers."""

    def __init__(
        self,
        path: Path,
        clock: Clock,
        robot: str | None = None,
        progress: Callable[[float], None] = lambda _: None,
    ) -> None:
        """Open a recording; UserError when it holds no frame.

        `progress` receives the share that was read.
        """
        self.log_index = LogIndex(open_log(path, robot), progress)
        if not len(self.log_index):
            why = f" ({self.damage})" if self.damage else ""
            raise UserError(f"{path}: holds no frame{why}")
        self.path = path
        self.robot = self.log_index.robot
        self.timeline = Timeline(clock, self.log_index.start_ns, self.log_index.duration_ns)
        self.marks: tuple[Bookmark, ...] = marks_in(self.log_index)
        self._ticks = self._tick_times()
        self._next = 0
        self._handlers: dict[tuple[str, str], list[Handler]] = {}  # by robot and path

    @property
    def damage(self) -> str:
        """Description of what the recording has lost."""
        return self.log_index.damage

    def mailbox(
        self,
        topic: Topic[M],
        robot: str | None = None,
        notify: Callable[[int], None] | None = None,
        *,
        take: Handler | None = None,
    ) -> Mailbox[M]:
        """Return a mailbox that receives a topic."""
        box = Mailbox(topic, notify)

        def store(key: str, frame: bytes, arrived_ns: int) -> None:
            if take is not None:
                take(key, frame, arrived_ns)
            box.store(Sample(ENCODING, frame), arrived_ns)

        self.stream(topic, store, robot)
        return box

    def stream(self, topic: Topic[Any], handler: Handler, robot: str | None = None) -> None:
        """Subscribe to all frames of a topic."""
        self._handlers.setdefault((robot or self.robot, topic.path), []).append(handler)

    def present(self) -> list[RecordedPeer]:
        """Return the processes of all robots that sent a message in the three seconds before."""
        found = []
        for robot in self.log_index.robots:
            for role, topic in PRESENCE_TOPICS:
                newest = self.log_index.newest_on(topic.path, self._next, robot)
                if newest and self.timeline.position_ns - newest.time_ns <= PRESENCE_NS:
                    found.append(RecordedPeer(robot, role.value))
        return found

    def ask(
        self,
        service: Service,
        message: Message | None = None,
        timeout_s: float = 0.5,
        robot: str | None = None,
    ) -> Message | bytes:
        """Return the recorded world or parameters; raise NoAnswerError for any other request."""
        name = RECORDED.get(service.path)
        if name is None:
            raise NoAnswerError("a recording cannot answer requests to a robot")
        if name not in self.log_index.facts or robot not in (None, self.robot):
            raise NoAnswerError(f"the recording does not hold the {name}")
        text = self.log_index.facts[name]
        return (self._parameters_now(text) if service is PARAMETERS else text).encode()

    def advance(self) -> int:
        """Deliver all frames that are due; return their number."""
        return self._deliver(self.timeline.position_ns)

    def seek(self, time_s: float, look: Callable[[], None] = lambda: None) -> None:
        """Move to a later instant; `look` is called often, so that it sees intermediate states.

        More than a minute before the target, it delivers every event but only samples of streams:
        an hour takes about a second. Raises LocalError for an earlier instant: call `rewind` and
        subscribe again.
        """
        goal_ns = self.timeline.clamped(round(time_s * NS_PER_S))
        here_ns = self.timeline.position_ns
        if goal_ns < here_ns:
            raise LocalError(f"{time_s:g} s is earlier than the present position: rewind first")
        whole_ns = max(here_ns, goal_ns - WHOLE_NS)
        thin_ns = max(SLICE_NS, (whole_ns - here_ns) // MAX_SLICES)
        while here_ns < goal_ns:
            is_sampled = here_ns < whole_ns
            here_ns = min(whole_ns, here_ns + thin_ns) if is_sampled else here_ns + SLICE_NS
            here_ns = min(here_ns, goal_ns)
            self.timeline.move_to(here_ns)
            self._deliver(here_ns, is_sampled=is_sampled)
            look()
        self._deliver(goal_ns)

    def rewind(self) -> None:
        """Return to the beginning, paused, and drop all subscriptions."""
        self.timeline.pause()
        self.timeline.move_to(0)
        self._handlers.clear()
        self._next = 0

    def tick_after(self, time_s: float, ticks: int = 1) -> float:
        """Return the time in s at which the tick `ticks` later has been delivered completely."""
        if not self._ticks:
            return self.timeline.clamped(round(time_s * NS_PER_S)) / NS_PER_S
        here = bisect_right(self._ticks, round(time_s * NS_PER_S)) - 1
        place = min(max(here + ticks, 0), len(self._ticks) - 1)
        return self._ticks[place] / NS_PER_S

    def next_mark(self, time_s: float) -> Bookmark | None:
        """Return the next bookmark."""
        return next((mark for mark in self.marks if mark.time_s > time_s + 1e-9), None)

    def _deliver(self, until_ns: int, *, is_sampled: bool = False) -> int:
        end = self.log_index.after(until_ns)
        begin, self._next = self._next, max(self._next, end)
        for place in self._sampled(begin, end) if is_sampled else range(begin, end):
            played = self.log_index[place]
            parts = key_parts(played.key)
            for handler in self._handlers.get(parts[:2], ()) if parts else ():
                handler(played.key, played.frame, self.log_index.start_ns + played.time_ns)
        return max(0, end - begin)

    def _sampled(self, begin: int, end: int) -> list[int]:
        """Return the indices of every event and of the newest frame of each stream."""
        found, seen = [], set()
        for place in range(end - 1, begin - 1, -1):
            key = self.log_index.key(place)
            if key not in seen or path_of(key) in EVENTS:
                found.append(place)
                seen.add(key)
        return found[::-1]

    def _tick_times(self) -> list[int]:
        """Return the last instant of each tick, just before the robot's next wheel command."""
        begins = self.log_index.times_ns(DRIVE.path) or self.log_index.times_ns(STATUS.path)
        ends = [max(0, time_ns - 1) for time_ns in begins[1:]]
        return [*ends, self.log_index.duration_ns] if begins else []

    def _parameters_now(self, text: str) -> str:
        """Return the recorded list with values set since; RemoteError when it is malformed."""
        rows = rows_in(text)
        for time_ns, answer in self.log_index.on(ANSWERED.path):
            if isinstance(answer, ParamValue) and time_ns <= self.timeline.position_ns:
                value = float(f"{answer.param_value:.7g}")  # float32 carries seven digits
                for row in rows:
                    if row["name"] == answer.param_id and isfinite(value):
                        row["value"] = value
        return json.dumps(rows)
