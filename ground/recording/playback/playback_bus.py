"""A recording that can be listened to like a live bus, on a timeline of its own.

Whoever shows it polls `advance`; frames are handed on in the caller's thread. Nothing can be asked
of a robot that is not there: only what was recorded is answered.
"""

import json
from bisect import bisect_right
from collections.abc import Callable
from math import isfinite
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

from ground.client.parameter_rows import rows_in
from ground.recording.bookmarks import Mark, marks_of
from ground.recording.log_index import LogIndex
from ground.recording.log_reader import opened
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
    path_of,
)
from protocol.wire.message import Message
from protocol.wire.messages import ParamValue
from runtime.clock import Clock
from runtime.errors import LocalError, NoAnswer, UserError
from runtime.units import NS_PER_S

M = TypeVar("M", bound=Message)
Handler = Callable[[str, bytes, int], None]
THERE_NS: Final = 3 * NS_PER_S
SLICE_NS: Final = NS_PER_S // 5
WHOLE_NS: Final = 60 * NS_PER_S
MOST_SLICES: Final = 1000
HEARD_ON: Final = ((Role.ROBOT, HEARTBEAT), (Role.PLANT, WHEELS), (Role.GROUND, OPERATOR))
EVENTS: Final = frozenset(topic.path for topic in TOPICS if not topic.rate_hz)
RECORDED: Final = {WORLD.path: "world", PARAMETERS.path: "parameters"}


class Present(NamedTuple):
    """Somebody who was heard in the recording shortly before."""

    robot: str
    role: str
    zid: str = "recording"


class ReplayBus:
    """Plays one recording. `clock` is the real one; `timeline` is the clock of those who listen."""

    def __init__(self, path: Path, clock: Clock, robot: str | None = None) -> None:
        """UserError when there is nothing to play."""
        self.reel = LogIndex(opened(path, robot))
        if not len(self.reel):
            why = f" ({self.damage})" if self.damage else ""
            raise UserError(f"{path}: holds no frame{why}")
        self.path = path
        self.robot = self.reel.robot
        self.timeline = Timeline(clock, self.reel.start_ns, self.reel.duration_ns)
        self.marks: tuple[Mark, ...] = marks_of(self.reel)
        self._ticks = self._tick_times()
        self._next = 0
        self._handlers: dict[str, list[Handler]] = {}

    @property
    def damage(self) -> str:
        return self.reel.damage

    # What a bus can do.

    def mailbox(
        self,
        topic: Topic[M],
        robot: str | None = None,
        notify: Callable[[int], None] | None = None,
        *,
        take: Handler | None = None,
    ) -> Mailbox[M]:
        box = Mailbox(topic, notify)

        def store(key: str, frame: bytes, arrived_ns: int) -> None:
            if take is not None:
                take(key, frame, arrived_ns)
            box.store(Sample(ENCODING, frame), arrived_ns)

        self.stream(topic, store, robot)
        return box

    def stream(self, source: Topic[Any] | str, handler: Handler, robot: str | None = None) -> None:
        """Every frame of a topic, or of a key that may end in `/**`."""
        key = source if isinstance(source, str) else source.key(robot or self.robot)
        if not isinstance(source, str) and source.of_operators:
            key = f"{key}/**"
        self._handlers.setdefault(key, []).append(handler)

    def present(self) -> list[Present]:
        """Who was heard in the three seconds before."""
        found = []
        for role, topic in HEARD_ON:
            newest = self.reel.newest_on(topic.path, self._next)
            if newest and self.timeline.position_ns - newest.time_ns <= THERE_NS:
                found.append(Present(self.robot, role.value))
        return found

    def ask(
        self,
        service: Service,
        message: Message | None = None,
        timeout_s: float = 0.5,
        robot: str | None = None,
    ) -> Message | bytes:
        """World and parameters as they were then; NoAnswer for all that needs a robot."""
        name = RECORDED.get(service.path)
        if name is None:
            raise NoAnswer("this is a recording: nobody is there to be asked")
        if name not in self.reel.facts:
            raise NoAnswer(f"the recording does not hold the {name}")
        text = self.reel.facts[name]
        return (self._parameters_now(text) if service is PARAMETERS else text).encode()

    # What a timeline can do.

    def advance(self) -> int:
        """Hand on all that has become due; how many frames that were."""
        return self._deliver(self.timeline.position_ns)

    def seek(self, time_s: float, look: Callable[[], None] = lambda: None) -> None:
        """Go on to a later instant; `look` is called often on the way, so that it sees the way.

        Of what is farther back than the last minute it sees every event, but of streams only
        samples: an hour is gone through in about a second. LocalError when it is earlier:
        `rewind` first, and listen anew.
        """
        goal_ns = self.timeline.held(round(time_s * NS_PER_S))
        here_ns = self.timeline.position_ns
        if goal_ns < here_ns:
            raise LocalError(f"{time_s:g} s is behind us: rewind first")
        whole_ns = max(here_ns, goal_ns - WHOLE_NS)
        thin_ns = max(SLICE_NS, (whole_ns - here_ns) // MOST_SLICES)
        while here_ns < goal_ns:
            thinned = here_ns < whole_ns
            here_ns = min(whole_ns, here_ns + thin_ns) if thinned else here_ns + SLICE_NS
            here_ns = min(here_ns, goal_ns)
            self.timeline.move_to(here_ns)
            self._deliver(here_ns, thinned=thinned)
            look()
        self._deliver(goal_ns)

    def rewind(self) -> None:
        """To the beginning, paused. Who listened is forgotten: what was seen is not yet so."""
        self.timeline.pause()
        self.timeline.move_to(0)
        self._handlers.clear()
        self._next = 0

    def tick_after(self, time_s: float, ticks: int = 1) -> float:
        """When the tick so many ticks later (or, below zero, earlier) has been heard in full."""
        if not self._ticks:
            return self.timeline.held(round(time_s * NS_PER_S)) / NS_PER_S
        here = bisect_right(self._ticks, round(time_s * NS_PER_S)) - 1
        place = min(max(here + ticks, 0), len(self._ticks) - 1)
        return self._ticks[place] / NS_PER_S

    def mark_after(self, time_s: float, *, back: bool = False) -> Mark | None:
        """The next mark, or the one before."""
        if back:
            return next((one for one in reversed(self.marks) if one.time_s < time_s - 1e-9), None)
        return next((one for one in self.marks if one.time_s > time_s + 1e-9), None)

    def _deliver(self, until_ns: int, *, thinned: bool = False) -> int:
        end = self.reel.after(until_ns)
        begin, self._next = self._next, max(self._next, end)
        for place in self._sampled(begin, end) if thinned else range(begin, end):
            played = self.reel[place]
            for handler in self._listeners(played.key):
                handler(played.key, played.frame, self.reel.start_ns + played.time_ns)
        return max(0, end - begin)

    def _sampled(self, begin: int, end: int) -> list[int]:
        """Every event, and of each stream the newest."""
        found, seen = [], set()
        for place in range(end - 1, begin - 1, -1):
            key = self.reel.key(place)
            if key not in seen or path_of(key) in EVENTS:
                found.append(place)
                seen.add(key)
        return found[::-1]

    def _listeners(self, key: str) -> list[Handler]:
        wide = (one for one in self._handlers if one.endswith("/**"))
        found = [h for one in wide if f"{key}/".startswith(one[:-2]) for h in self._handlers[one]]
        return [*self._handlers.get(key, ()), *found]

    def _tick_times(self) -> list[int]:
        """The last instant of each tick: just before the robot's next wheel command."""
        begins = self.reel.times_ns(DRIVE.path) or self.reel.times_ns(STATUS.path)
        ends = [max(0, time_ns - 1) for time_ns in begins[1:]]
        return [*ends, self.reel.duration_ns] if begins else []

    def _parameters_now(self, text: str) -> str:
        """The list as recorded, with the values that were set since; RemoteError: it is none."""
        rows = rows_in(text)
        for time_ns, answer in self.reel.on(ANSWERED.path):
            if isinstance(answer, ParamValue) and time_ns <= self.timeline.position_ns:
                value = float(f"{answer.param_value:.7g}")  # float32 carries seven digits
                for row in rows:
                    if row["name"] == answer.param_id and isfinite(value):
                        row["value"] = value
        return json.dumps(rows)
