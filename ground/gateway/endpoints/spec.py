"""Parse the endpoints of the command line: `udpin:HOST:PORT`, `udpout:HOST:PORT`."""

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType
from typing import Final

from ground.gateway.endpoints.endpoint import Endpoint
from ground.gateway.endpoints.udp import UdpEndpoint
from runtime.errors import UserError

KINDS: Final[Mapping[str, Callable[[str, str, int], Endpoint]]] = MappingProxyType(
    {
        "udpin": partial(UdpEndpoint, listens=True),
        "udpout": partial(UdpEndpoint, listens=False),
    }
)
EXAMPLE: Final = "udpin:127.0.0.1:14550"


def opened(text: str) -> Endpoint:
    """Open an endpoint; UserError names what is wrong with it."""
    kind, _, rest = text.partition(":")
    host, colon, port = rest.rpartition(":")
    if kind not in KINDS:
        raise UserError(f"endpoint {text!r}: {kind!r} is not one of {', '.join(KINDS)}")
    if not (colon and host and port.isdecimal() and int(port) < 65_536):
        raise UserError(f"endpoint {text!r}: use {kind}:HOST:PORT, as in {EXAMPLE}")
    return KINDS[kind](text, host, int(port))
