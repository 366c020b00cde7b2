"""Find the files of the recorders of this run, without other files in the same folder."""

import re
from pathlib import Path
from typing import Final

from ground.launch.child_processes import Children
from ground.recording.log_reader import robot_in
from protocol.topic import NAME

RECORDER: Final = "recorder"
"""Prefix of the role of each recorder."""
CREATED: Final = re.compile(
    rf"^recording .*?(?P<name>\d{{8}}T\d{{6}}Z-{NAME}(\.\d{{1,3}})?\.tlog) and \.mcap$",
    re.MULTILINE,
)


def created_line(robot: str, log: Path) -> str:
    """Return the line that a recorder prints when it has created its files."""
    return f"recording {robot} to {log} and .mcap"


class RecorderFiles:
    """The .tlog of each recorder among some children.

    Another run may record a robot of the same name in the same folder, so the names and times of
    the files do not identify the run. Each recorder prints the name of its file.
    """

    def __init__(self) -> None:
        self._found: dict[int, Path] = {}

    @property
    def all(self) -> list[Path]:
        """The files of all recorders so far, the newest last."""
        return list(self._found.values())

    def newest(self, robot: str) -> Path | None:
        """Return the file of the newest recorder of a robot, or None before one has created it."""
        return next((log for log in reversed(self.all) if robot_in(log) == robot), None)

    def update(self, children: Children, folder: Path) -> None:
        """Read the output of new recorders; call it before a child is removed."""
        for child in children.snapshot():
            pid = child.process.pid
            if child.role.startswith(RECORDER) and pid not in self._found:
                created = CREATED.search(child.first_output())
                if created is not None:
                    self._found[pid] = folder / created["name"]
