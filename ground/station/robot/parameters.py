"""The robot's parameters as last read: all of them, or none."""

from ground.client.parameter_rows import Row
from protocol.wire.messages import ParamValue


class ParameterList:
    """After a loss there are none until all were read again."""

    def __init__(self) -> None:
        self.rows: tuple[Row, ...] | None = None
        self._known = 0
        self._why = ""

    def lose(self) -> None:
        self.rows = None
        self._why = ""

    def read(self, rows: tuple[Row, ...]) -> None:
        self.rows = rows
        self._known = len(rows)
        self._why = ""

    def failed(self, why: str) -> None:
        self._why = why

    def changed(self, value: ParamValue) -> None:
        """Somebody has set one: the robot has said its new value."""
        if self.rows is None:
            return
        self.rows = tuple(
            {**row, "value": value.param_value} if row["name"] == value.param_id else row
            for row in self.rows
        )

    def words(self, asked: int) -> str:
        """How many there are, or how many are missing and why."""
        if self.rows is not None:
            return f"{len(self.rows)}"
        missing = f"all {self._known} missing" if self._known else "not read yet"
        times = f"asked {asked} {'time' if asked == 1 else 'times'}" if asked else "not asked yet"
        return f"{missing}: {times}{f', {self._why}' if self._why else ''}"
