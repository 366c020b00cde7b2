"""The settings of the gateway: defaults, the table `[gateway]` of a file, then the command line."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Final, NamedTuple

from msgspec import Meta

from gateways.mavlink.endpoints.addresses import explained, is_loopback, resolved
from gateways.mavlink.endpoints.spec import EXAMPLE, MAX_PORT, TCP, parsed
from gateways.mavlink.frames.globe import (
    DEFAULT_ALTITUDE_M,
    DEFAULT_ORIGIN,
    home_at,
    place_of,
)
from gateways.mavlink.signing.policy import Policy
from ground.missions.mission import Home
from protocol.topics import robot_name
from runtime.config import load_shared
from runtime.errors import UserError

MAX_SYSTEM: Final = 250
"""Larger ids are usual for ground stations."""
LOW_RATE_BYTES_S: Final = 4_800
"""Limit of the rate to a client with `low_rate`; streams use 90 % of it. It fits 57,600 baud."""
MAX_ALTITUDE_M: Final = 20_000.0

Latitude = Annotated[float, Meta(ge=-85.0, le=85.0)]
Longitude = Annotated[float, Meta(ge=-180.0, le=180.0)]
System = Annotated[int, Meta(ge=1, le=MAX_SYSTEM)]


@dataclass(frozen=True, kw_only=True)
class GatewaySettings:
    """The table `[gateway]`.

    `endpoints` as on the command line. `robots` are presented; without them the robot of the
    connection. `systems` are their MAVLink system ids by name; the others get the lowest free ones
    in the order of their names. `origin` is the place of (0, 0) on the globe. `keys` is the file of
    the signing keys.
    """

    endpoints: tuple[str, ...] = (EXAMPLE,)
    robots: tuple[str, ...] = ()
    systems: dict[str, System] = field(default_factory=dict)
    origin: tuple[Latitude, Longitude] = (DEFAULT_ORIGIN.latitude_deg, DEFAULT_ORIGIN.longitude_deg)
    altitude_m: Annotated[float, Meta(ge=-1000.0, le=MAX_ALTITUDE_M)] = DEFAULT_ALTITUDE_M
    low_rate: bool = False
    keys: str = ""

    @property
    def home(self) -> Home:
        """The origin."""
        return Home(latitude_deg=self.origin[0], longitude_deg=self.origin[1])


@dataclass(frozen=True, kw_only=True)
class GatewayFile:
    """The part of a `--config` file that only the gateway reads."""

    gateway: GatewaySettings = GatewaySettings()


class EndpointText(NamedTuple):
    """An endpoint without its policy, and the policy."""

    text: str
    policy: Policy


def settings_in(path: str | None) -> GatewaySettings:
    """Return the table of a file, or the defaults without a file; ConfigError for a wrong key."""
    return GatewaySettings() if path is None else load_shared(Path(path), GatewayFile).gateway


def with_policy(text: str) -> EndpointText:
    """Split `udpin:HOST:PORT,require`; LOOPBACK is the default. UserError for wrong words.

    ACCEPT is refused by TCP on an address that other machines reach, for browsers reach it, too.
    """
    place, comma, word = text.partition(",")
    kind, host, number = parsed(place)
    if place.endswith(":0"):
        raise UserError(
            f"endpoint {text!r}: clients cannot find port 0: give one of 1 to {MAX_PORT}"
        )
    try:
        policy = Policy(word) if comma else Policy.LOOPBACK
    except ValueError:
        known = ", ".join(policy.value for policy in Policy)
        example = f"{place},{Policy.REQUIRE.value}"
        raise UserError(
            f"endpoint {text!r}: {word!r} is none of {known}; as in {example}"
        ) from None
    if kind == TCP and policy is Policy.ACCEPT:
        with explained(text):
            is_here = is_loopback(resolved(host, number))
        if not is_here:
            raise UserError(
                f"endpoint {text!r}: by TCP a program that was never meant to, such as a browser,"
                f" can send commands without a signature: use {Policy.REQUIRE.value}, which takes"
                f" signed ones, or a udpin endpoint, or {Policy.ANYONE.value} if you want just that"
            )
    return EndpointText(place, policy)


def origin_in(latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
    """Return an origin; UserError if it is not one."""
    if home_at(place_of(latitude_deg, longitude_deg)) is None:
        here = f"{latitude_deg:g} {longitude_deg:g}"
        raise UserError(f"--origin {here}: LAT -85 to 85, LON -180 to 180, not both 0")
    return latitude_deg, longitude_deg


def system_in(text: str) -> tuple[str, int]:
    """Parse `r1=7`; UserError for anything else."""
    name, _, number = text.partition("=")
    if not (number.isascii() and number.isdecimal() and 1 <= int(number) <= MAX_SYSTEM):
        raise UserError(f"--system {text}: use ROBOT=ID with an id of 1 to {MAX_SYSTEM}, as r1=1")
    return robot_name(name), int(number)


def systems_of(robots: Sequence[str], given: Mapping[str, int]) -> dict[str, int]:
    """Return the system id of each robot; UserError for unknown robots and for ids given twice."""
    for name in given:
        if name not in robots:
            known = ", ".join(robots)
            raise UserError(f"system {name}={given[name]}: the gateway has no {name}, only {known}")
    taken = set(given.values())
    if len(taken) < len(given):
        raise UserError(f"systems {dict(given)}: each robot needs an id of its own")
    free = (number for number in range(1, MAX_SYSTEM + 1) if number not in taken)
    chosen = {name: given[name] if name in given else next(free) for name in sorted(set(robots))}
    return {name: chosen[name] for name in robots}


def robots_in(names: Sequence[str]) -> list[str]:
    """Return the names of robots, separated by commas; UserError for wrong ones."""
    found = [robot_name(name) for words in names for name in words.split(",") if name]
    if len(set(found)) < len(found):
        raise UserError(f"--robots {','.join(found)}: each robot only once")
    return found
