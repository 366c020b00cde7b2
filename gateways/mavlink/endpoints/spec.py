"""Parse the endpoints of the command line, such as `udpin:127.0.0.1:14550`, and open them."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from difflib import get_close_matches
from functools import partial
from types import MappingProxyType
from typing import Final, NamedTuple

from gateways.mavlink.endpoints.endpoint import Endpoint
from gateways.mavlink.endpoints.serial import SerialEndpoint
from gateways.mavlink.endpoints.tcp import TcpEndpoint
from gateways.mavlink.endpoints.udp import UdpEndpoint
from runtime.errors import UserError

TCP: Final = "tcpin"
SERIAL: Final = "serial"
KINDS: Final[Mapping[str, Callable[[str, str, int], Endpoint]]] = MappingProxyType(
    {
        "udpin": partial(UdpEndpoint, listens=True),
        "udpout": partial(UdpEndpoint, listens=False),
        TCP: TcpEndpoint,
        SERIAL: SerialEndpoint,
    }
)
EXAMPLE: Final = "udpin:127.0.0.1:14550"
MAX_PORT: Final = 65_535


class Place(NamedTuple):
    """The parts of an endpoint: its kind, host or device, and port or speed."""

    kind: str
    name: str
    number: int


def parsed(text: str) -> Place:
    """Parse an endpoint; UserError names the error and the fix."""
    kind, _, rest = text.partition(":")
    if kind not in KINDS:
        near = get_close_matches(kind, KINDS, n=1)
        fix = f"did you mean {near[0]}?" if near else f"use one as in {EXAMPLE}"
        raise UserError(f"endpoint {text!r}: {kind!r} is none of {', '.join(KINDS)}; {fix}")
    place, _, number = rest.rpartition(":")
    form, example = "HOST:PORT", EXAMPLE.replace("udpin", kind)
    if kind == SERIAL:
        form, example = "DEVICE:BAUD", "serial:/dev/ttyUSB0:57600"
    if not (place and number.isascii() and number.isdecimal()):
        raise UserError(f"endpoint {text!r}: use {kind}:{form}, as in {example}")
    if kind != SERIAL and int(number) > MAX_PORT:
        raise UserError(f"endpoint {text!r}: ports end at {MAX_PORT}")
    return Place(kind, place, int(number))


def opened(text: str) -> Endpoint:
    """Open an endpoint; UserError names the error and the fix."""
    kind, name, number = parsed(text)
    return KINDS[kind](text, name, number)


def all_opened(texts: Sequence[str]) -> list[Endpoint]:
    """Open several endpoints; after a UserError none remains open."""
    with ExitStack() as stack:
        found = [stack.enter_context(closing(opened(text))) for text in texts]
        stack.pop_all()
    return found
