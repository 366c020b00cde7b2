"""The bus between processes, and the only import of Zenoh."""

from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network
from protocol.bus.presence import Presence
from protocol.bus.publisher import Publisher
from protocol.bus.service import Asked, refusal

__all__ = ["Asked", "Bus", "Network", "Presence", "Publisher", "open_bus", "refusal"]
