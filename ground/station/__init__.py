"""The ground station without its screen: all that is shown, as a model that needs no terminal."""

from ground.station.contact import Need
from ground.station.hears import Hears, Speaks
from ground.station.history import SERIES, History, Series
from ground.station.lease import Lease
from ground.station.log import Line, Log
from ground.station.loss import Loss, LossKind
from ground.station.moments import Moment
from ground.station.requests import Outcome
from ground.station.station import Station
from ground.station.streams import StreamRow
from ground.station.world import WorldFacts

__all__ = [
    "SERIES",
    "Hears",
    "History",
    "Lease",
    "Line",
    "Log",
    "Loss",
    "LossKind",
    "Moment",
    "Need",
    "Outcome",
    "Series",
    "Speaks",
    "Station",
    "StreamRow",
    "WorldFacts",
]
