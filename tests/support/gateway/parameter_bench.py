"""A bench whose robot has the parameters of the robot's own table."""

import json
from pathlib import Path
from typing import Any

from gateways.mavlink.mav_service import Sender
from gateways.mavlink.mav_vehicle import Face
from gateways.mavlink.mavlink_dialect import MavMessage
from gateways.mavlink.services import parameters_and_files
from ground.client.operations.parameters import ParameterTable, ShowParameters
from ground.client.parameter import parameters_in
from robot.core.parameters import DEFAULTS
from robot.parameter_table import described, with_value
from tests.support.gateway.fake_port import CLIENT, Bench


def robot_table(**values: float) -> ParameterTable:
    """Return what the robot's list contains if some values differ from their defaults."""
    params = DEFAULTS
    for name, value in values.items():
        params = with_value(params, name, value)
    return ParameterTable(tuple(parameters_in(json.dumps(described(params)))))


class ParameterBench(Bench):
    """A bench with parameters, files and logs; the robot answers each request for the list."""

    def __init__(self, recordings: Path | None = None) -> None:
        super().__init__()
        self.values: dict[str, float] = {}
        self.is_answering = True
        self.face = Face(self.vehicle, parameters_and_files(self.vehicle, recordings))

    def send(self, message: MavMessage, sender: Sender = CLIENT) -> list[MavMessage]:
        """Give a message to the face; return what it sends at once and when the robot answers."""
        found = super().send(message, sender)
        return found + self.answer_lists()

    def answer_lists(self) -> list[MavMessage]:
        """Answer the waiting requests for the list."""
        while self.is_answering and self.port.waiting and self._asks_for_list():
            self.port.answer(robot_table(**self.values))
        return self.sent()

    def after(self, seconds: float) -> list[MavMessage]:
        """Let time pass; the robot answers requests for the list."""
        found: list[MavMessage] = []
        end_ns = self.now_ns + round(seconds * 1e9)
        while self.now_ns < end_ns:
            found += super().after(0.02)
            found += self.answer_lists()
        return found

    def _asks_for_list(self) -> bool:
        operation, _ = self.port.waiting[0]
        return isinstance(operation, ShowParameters)


def of_type(messages: list[MavMessage], name: str) -> list[Any]:
    """Return the messages of one type."""
    return [one for one in messages if one.get_type() == name]
