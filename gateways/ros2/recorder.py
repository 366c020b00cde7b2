"""Record what a gateway publishes as a bag of ROS 2, without delaying its event loop.

A thread writes, with the guards of every recorder of this product: what waits for a full or slow
disk is bounded and counted, and the user is told.
"""

import threading
import time
from datetime import UTC, datetime
from itertools import count
from pathlib import Path
from typing import Final, Self

from ground.cli.observe.record import Alarms
from ground.launch.recording_session import byte_limit
from ground.recording.catalogue import Retention, part_bytes
from ground.recording.log_writer import FLUSH_NS, SYNC_EVERY, DualLog
from ground.ros2.bag_file import PART_S, Bag, bag_log, new_bag
from ground.ros2.offer import RosTopic
from ground.text.output import Output
from runtime.errors import UserError
from runtime.units import NS_PER_S

FLUSH_S: Final = FLUSH_NS / NS_PER_S


class BagRecorder:
    """Writes a new bag in a folder, which is created; `keep` limits what the folder holds."""

    def __init__(self, folder: Path, keep: str | None, output: Output) -> None:
        """Begin a bag; UserError if that fails."""
        self.is_complete = True
        """Whether nothing was lost; known at the end."""

        keep_bytes = byte_limit(folder, keep)
        self._output = output
        try:
            self._bag: Bag = new_bag(folder, datetime.now(UTC), keep_bytes)
            size = part_bytes(keep_bytes)
            self._log: DualLog = bag_log(self._bag, part_bytes=size, part_s=PART_S)
        except OSError as error:
            raise UserError(f"cannot record in {folder}: {error.strerror or error}") from error
        output.note(f"recording to {self._bag.path}")
        if warning := Retention(folder, keep_bytes).warning():
            output.note(warning)
        self._ending = threading.Event()
        self._writing = threading.Thread(target=self._write, name="ros2 recorder", daemon=True)

    def take(self, topic: RosTopic, data: bytes) -> None:
        """Record a message that is published now."""
        self._bag.topics.setdefault(topic.name, topic)
        self._log.take(topic.name, data, time.time_ns())

    def __enter__(self) -> Self:
        self._writing.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._writing.join()
        self.is_complete = self._log.close()
        writer = self._log.tracks[0].writer
        lost = f", {writer.dropped} LOST ({writer.drop_reason})" if writer.dropped else ""
        self._output.note(f"{self._bag.path}: {writer.written} messages{lost}")

    def _write(self) -> None:
        alarms = Alarms(self._output)
        for number in count(1):
            if self._ending.wait(FLUSH_S):
                return
            self._log.flush(number, SYNC_EVERY)
            alarms.look(self._log, time.monotonic_ns())
