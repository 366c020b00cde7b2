"""Play a recording through the interface of a bus, on its own timeline.

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
from ground.recording.bookmarks import Mark, marks_in
from ground.recording.log_index import LogIndex
from ground.recording.log_reader import open_log
from ground.recording.playback.playback_clock import Timeline
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
        self.marks: tuple[Mark, ...] = marks_in(self.log_index)
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

    def next_mark(self, time_s: float) -> Mark | None:
        """Return the next bookmark."""
        return next((one for one in self.marks if one.time_s > time_s + 1e-9), None)

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
