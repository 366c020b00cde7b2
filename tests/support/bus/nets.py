"""Small networks on loopback, each with its own port and prefix, closed when the test ends."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import count
from typing import Literal

from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network
from protocol.topics import Role

Topology = Literal["hub", "router"]
TOPOLOGIES: tuple[Topology, ...] = ("hub", "router")
prefixes = (f"test-{number}" for number in count())


class Net:
    """Robot, plant and ground on one bus; in the hub topology the robot is what others dial."""

    def __init__(self, stack: ExitStack, topology: Topology) -> None:
        self.prefix = next(prefixes)
        self._stack = stack
        listening = Network(
            mode="peer" if topology == "hub" else "router",
            listen=("tcp/127.0.0.1:0",),
            prefix=self.prefix,
        )
        first = stack.enter_context(open_bus(listening, Role.ROBOT, "r1"))
        self.endpoint = first.locator()
        self.robot = first if topology == "hub" else self.join(Role.ROBOT)
        self.plant = self.join(Role.PLANT)
        self.ground = self.join(Role.GROUND)

    def join(self, role: Role | None, robot: str = "r1") -> Bus:
        return self._stack.enter_context(self.opened(role, robot))

    def opened(self, role: Role | None, robot: str = "r1") -> Bus:
        """Return a bus that the caller closes."""
        network = Network(mode="client", connect=(self.endpoint,), prefix=self.prefix)
        return open_bus(network, role, robot)


@contextmanager
def net(topology: Topology = "hub") -> Iterator[Net]:
    with ExitStack() as stack:
        yield Net(stack, topology)
