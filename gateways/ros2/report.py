"""What a robot tells in words: /rosout, and /diagnostics with a level for each part."""

import time
from collections.abc import Callable, Mapping
from typing import Final

from rosbags.typesys.stores.ros2_jazzy import diagnostic_msgs__msg__DiagnosticStatus as Part

from gateways.ros2.node import RosNode, RosPublisher
from ground.ros2.reports import WARN, diagnostics, log_line, logger_name, part
from runtime.units import NS_PER_S

AGAIN_NS: Final = 30 * NS_PER_S
"""Time after which the same words are logged again."""

MAX_TOLD: Final = 100


class Reporter:
    """Logs to /rosout; `note` shows each line of a level from WARN on to the user, too."""

    def __init__(
        self,
        node: RosNode,
        publishers: Mapping[str, RosPublisher],
        now_ns: Callable[[], int],
        note: Callable[[str], None],
    ) -> None:
        self._now_ns, self._note = now_ns, note
        self._log, self._diagnostics = publishers["/rosout"], publishers["/diagnostics"]
        self.logger = logger_name(node.name.resolve(node.name.name))
        self._told: dict[str, int] = {}

    def log(self, level: int, text: str) -> None:
        """Log a line."""
        self._log.publish(log_line(time.time_ns(), level, self.logger, text))
        if level >= WARN:
            self._note(text)

    def warn_once(self, text: str) -> None:
        """Log a warning, but not the same one over and over."""
        now_ns = self._now_ns()
        if now_ns - self._told.get(text, -AGAIN_NS) < AGAIN_NS:
            return
        if len(self._told) >= MAX_TOLD:
            self._told.clear()
        self._told[text] = now_ns
        self.log(WARN, text)

    def diagnose(self, *parts: Part) -> None:
        """Publish the state of all parts."""
        self._diagnostics.publish(diagnostics(time.time_ns(), parts))

    def part(self, level: int, name: str, text: str, **values: object) -> Part:
        """Return the state of a part, with its values in words."""
        return part(self.logger, level, name, text, **values)
