"""The ground station without its screen: all that is shown, as a model that needs no terminal."""

from ground.station.bus_protocols import LiveBus, ReadableBus
from ground.station.history.decision_history import Moment
from ground.station.history.event_log import Line, Log
from ground.station.history.time_series import SERIES, History, Series
from ground.station.link.contact import Need
from ground.station.link.loss import Loss, LossKind
from ground.station.link.streams import StreamRow
from ground.station.robot.background_requests import JobResult
from ground.station.robot.lease_state import Lease
from ground.station.station import Station
from ground.station.world import WorldFacts

__all__ = [
    "SERIES",
    "History",
    "JobResult",
    "Lease",
    "Line",
    "LiveBus",
    "Log",
    "Loss",
    "LossKind",
    "Moment",
    "Need",
    "ReadableBus",
    "Series",
    "Station",
    "StreamRow",
    "WorldFacts",
]
