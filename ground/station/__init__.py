"""Model everything the ground station shows, without a terminal."""

from ground.station.bus_protocols import LiveBus, ReadableBus
from ground.station.history.decision_history import Moment
from ground.station.history.event_log import EventLog, LogLine
from ground.station.history.time_series import SERIES, Series, SeriesTable
from ground.station.link.contact import Need
from ground.station.link.loss import Loss, LossKind
from ground.station.link.streams import StreamRow
from ground.station.robot.background_requests import JobResult
from ground.station.robot.lease_state import LeaseView
from ground.station.station import Station
from ground.station.world import WorldFacts

__all__ = [
    "SERIES",
    "EventLog",
    "JobResult",
    "LeaseView",
    "LiveBus",
    "LogLine",
    "Loss",
    "LossKind",
    "Moment",
    "Need",
    "ReadableBus",
    "Series",
    "SeriesTable",
    "Station",
    "StreamRow",
    "WorldFacts",
]
