"""Turn a recording into a bag of ROS 2, with the topics that the gateway would have published.

Times of messages are those of their arrival at the recorder. In a simulation, which may run faster
than the clock, they advance with the simulation. Stamps are made as by the gateway. What no
recording holds is missing: the services and actions, and what the gateway says about itself.
"""

from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Final, NamedTuple

from ground.client.parameter_rows import rows_in
from ground.recording.log_reader import open_log
from ground.recording.mcap_file import McapFile
from ground.recording.tables import TimeAxis
from ground.ros2.bag_file import CHUNK_BYTES, Bag, encoded
from ground.ros2.offer import NODE, RosTopic, own_namespace, topics
from ground.ros2.reports import diagnostics, level_of, log_line, logger_name, robot_part
from ground.ros2.robot_topics import RobotTopics, Shown
from protocol.topics import CLOCK, key_parts
from protocol.wire.message import Message
from protocol.wire.messages import (
    AvoidanceDecision,
    LeaseStatus,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
    Statustext,
)
from protocol.wire.statustext import StatustextAssembler
from runtime.errors import RemoteError
from runtime.units import NS_PER_S, NS_PER_US

DRAW_NS: Final = NS_PER_S // 2
DIAGNOSE_NS: Final = NS_PER_S
FIRST_FRAMES: Final = 1000
"""Number of frames among which a simulation shows its clock."""


class RosMessage(NamedTuple):
    """A message on a topic with an absolute name, and its time in UTC."""

    topic: RosTopic
    message: object
    time_ns: int


class RecordedRobot:
    """One robot of a recording."""

    def __init__(self, name: str, *, is_simulated: bool, parameters: dict[str, float]) -> None:
        self._shown = RobotTopics(name, scan=True, is_simulated=is_simulated)
        namespace = own_namespace(name)
        self._topics = {key: one.below(namespace) for key, one in topics(scan=True).items()}
        self._parameters = parameters
        self._logger = logger_name(f"{namespace}/{NODE}")
        self._texts = StatustextAssembler()
        self._pose: PlanarOdometry | None = None
        self._status: NavigatorStatus | None = None
        self._decision: AvoidanceDecision | None = None
        self._scan: SonarScan | None = None
        self._lease: LeaseStatus | None = None
        self._drawn_ns = self._diagnosed_ns = 0

    def take(self, message: Message, arrived_ns: int) -> Iterator[RosMessage]:
        """Yield what follows from a message that arrived at this time."""
        for name, found in self._all(message, arrived_ns):
            yield RosMessage(self._topics[name], found, arrived_ns)

    def _all(self, message: Message, arrived_ns: int) -> Iterator[Shown]:
        yield from self._shown.shape(self._parameters)
        yield from self._shown.take(message, arrived_ns)
        if isinstance(message, Statustext) and (text := self._texts.receive(message)):
            yield "/rosout", log_line(arrived_ns, level_of(message.severity), self._logger, text)
        self._keep(message)
        if self._status is None:
            return
        if arrived_ns - self._diagnosed_ns >= DIAGNOSE_NS:
            self._diagnosed_ns = arrived_ns
            part = robot_part(self._logger, self._status, self._pose, self._lease)
            yield "/diagnostics", diagnostics(arrived_ns, [part])
        if self._pose is not None and arrived_ns - self._drawn_ns >= DRAW_NS:
            self._drawn_ns = arrived_ns
            found = self._pose, self._status, self._decision
            yield from self._shown.plan(*found)
            yield self._shown.markers(*found, self._scan)

    def _keep(self, message: Message) -> None:
        if isinstance(message, PlanarOdometry):
            self._pose = message
        elif isinstance(message, NavigatorStatus):
            self._status = message
        elif isinstance(message, AvoidanceDecision):
            self._decision = message
        elif isinstance(message, SonarScan):
            self._scan = message
        elif isinstance(message, LeaseStatus):
            self._lease = message


class RecordedRun:
    """The robots of a recording, read once; `axis` counts what was read."""

    def __init__(self, path: Path, begin_s: float | None, end_s: float | None) -> None:
        self._is_simulated = any(
            frame.key.endswith(CLOCK.path) for frame in islice(open_log(path), FIRST_FRAMES)
        )
        self.axis = TimeAxis(open_log(path), begin_s, end_s)
        self._parameters = parameters_in(path)
        self._robots: dict[str, RecordedRobot] = {}

    def __iter__(self) -> Iterator[RosMessage]:
        own = self.axis.log.robot
        begin_s: float | None = None
        began_ns = newest_ns = 0
        for timed in self.axis:
            parts = key_parts(timed.path)
            name = own if parts is None else parts.robot
            if begin_s is None:
                begin_s, began_ns = timed.time_s, timed.arrived_ns
            arrived_ns = timed.arrived_ns
            if self._is_simulated:
                arrived_ns = began_ns + round((timed.time_s - begin_s) * NS_PER_S)
            newest_ns = max(newest_ns, arrived_ns)
            for found in self._robot(name, own).take(timed.message, newest_ns):
                if name == own or found.topic.name != "/clock":
                    yield found

    def _robot(self, name: str, own: str) -> RecordedRobot:
        robot = self._robots.get(name)
        if robot is None:
            known = self._parameters if name == own else {}
            robot = RecordedRobot(name, is_simulated=self._is_simulated, parameters=known)
            self._robots[name] = robot
        return robot


def parameters_in(path: Path) -> dict[str, float]:
    """Return the values of the recorded parameters; empty when the recording has none."""
    with suppress(RemoteError, OSError, KeyError):
        rows = rows_in(McapFile(path.with_suffix(".mcap")).read_facts()["parameters"])
        values = {str(row["name"]): row["value"] for row in rows}
        return {name: float(one) for name, one in values.items() if isinstance(one, int | float)}
    return {}


def write_bag(run: RecordedRun, folder: Path) -> int:
    """Write the bag and return the number of its messages; OSError if that fails."""
    bag = Bag(folder)
    file, form = bag.begin(1)
    try:
        count = 0
        for topic, message, time_ns in run:
            bag.topics[topic.name] = topic
            time_us = time_ns // NS_PER_US
            form.add(topic.name, encoded(topic, message), time_us, time_us)
            count += 1
            if form.waiting_bytes > CHUNK_BYTES:
                file.append(form.batch())
        file.append(form.end())
        file.sync()
    finally:
        file.close()
    return count
