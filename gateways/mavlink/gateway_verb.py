"""`gateway`: present robots to MAVLink ground stations, until a signal ends it.

Its settings: defaults, the table `[gateway]` of a file, then the command line.
"""

import argparse
import asyncio
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Final, NamedTuple

from msgspec import Meta

from gateways.mavlink.bus_port import BusPort
from gateways.mavlink.coordinates import DEFAULT_ALTITUDE_M, DEFAULT_ORIGIN, home_at, place_of
from gateways.mavlink.endpoints import (
    EXAMPLE,
    TCP,
    Endpoint,
    all_opened,
    explained,
    is_loopback,
    parsed,
    resolved,
)
from gateways.mavlink.gateway import Gateway
from gateways.mavlink.mav_vehicle import MavVehicle
from gateways.mavlink.parameter_table import MAX_TIMEOUT_S, MIN_TIMEOUT_S
from gateways.mavlink.services import face_of
from gateways.mavlink.signing import BackgroundWriter, Policy, SigningGuard
from gateways.mavlink.traffic_recorder import TrafficRecorder, new_file
from ground.cli.options import common_of
from ground.client.connection import Common
from ground.client.robot_link import RobotLink, open_link
from ground.client.stop_ways import StopServer
from ground.commands.command import add_common
from ground.missions.mission import Home
from ground.recording.metadata import build
from ground.text.output import Output
from ground.user.folders import recordings_folder, state_folder
from ground.user.mavlink_keys import read_keys, usual_file, write_keys
from protocol.bus.network import MAX_PORT, gateway_here
from protocol.options import finite
from protocol.topics import robot_name
from runtime.clock import Clock
from runtime.config import load_shared
from runtime.errors import UserError

MAX_SYSTEM: Final = 250
"""Larger ids are usual for ground stations."""
LOW_RATE_BYTES_S: Final = 4_800
"""Limit of the rate to a client with `low_rate`; streams use 90 % of it. It fits 57,600 baud."""
MAX_ALTITUDE_M: Final = 20_000.0

Latitude = Annotated[float, Meta(ge=-85.0, le=85.0)]
Longitude = Annotated[float, Meta(ge=-180.0, le=180.0)]
Timeout = Annotated[float, Meta(ge=MIN_TIMEOUT_S, le=MAX_TIMEOUT_S)]
System = Annotated[int, Meta(ge=1, le=MAX_SYSTEM)]


@dataclass(frozen=True, kw_only=True)
class GatewaySettings:
    """The table `[gateway]`.

    `endpoints` as on the command line. `robots` are presented; without them the robot of the
    connection. `systems` are their MAVLink system ids by name; the others get the lowest free ones
    in the order of their names. `origin` is the place of (0, 0) on the globe. `guided_timeout_s` is
    the first value of GUID_TIMEOUT. `keys` is the file of the signing keys.
    """

    endpoints: tuple[str, ...] = (EXAMPLE,)
    robots: tuple[str, ...] = ()
    systems: dict[str, System] = field(default_factory=dict)
    origin: tuple[Latitude, Longitude] = (DEFAULT_ORIGIN.latitude_deg, DEFAULT_ORIGIN.longitude_deg)
    altitude_m: Annotated[float, Meta(ge=-1000.0, le=MAX_ALTITUDE_M)] = DEFAULT_ALTITUDE_M
    low_rate: bool = False
    guided_timeout_s: Timeout = MIN_TIMEOUT_S
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
            is_here = is_loopback(resolved(host, number)[1])
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


RECORD_HELP: Final = "record all traffic to a new .tlog with this name, or in this folder"
STAMPS: Final = "mavlink-stamp"
"""The file with the newest time stamp of a signature, in the state folder."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `gateway`."""
    text = (
        "endpoints for clients: udpin:HOST:PORT, udpout:HOST:PORT, tcpin:HOST:PORT or"
        " serial:DEVICE:BAUD; several are possible. After a comma: which clients may command:"
        " require (those that sign), loopback (also unsigned ones of this machine, the default),"
        " accept (all), anyone (all, also by TCP from other machines). Default"
        f" {EXAMPLE}"
    )
    parser.add_argument("endpoints", nargs="*", metavar="ENDPOINT", help=text)
    text = "the robots to present, as in r1,r2 (default: that of --id)"
    parser.add_argument("--robots", action="append", metavar="NAMES", help=text)
    text = "MAVLink system ids, as in r1=1 r2=2 (default: 1, 2, ... in the order of the names)"
    parser.add_argument("--system", nargs="+", metavar="NAME=ID", help=text)
    text = "place of x = 0, y = 0 on the globe, in degrees (default: the model airfield, Canberra)"
    parser.add_argument("--origin", nargs=2, type=finite, metavar=("LAT", "LON"), help=text)
    text = "limit the rate to the capacity of a radio of 57,600 baud"
    parser.add_argument("--low-rate", action="store_true", help=text)
    text = "file of the signing keys (default: that of `sidestep keys signing`)"
    parser.add_argument("--signing-keys", metavar="FILE", help=text)
    parser.add_argument("--record", metavar="FILE", help=RECORD_HELP)
    folder = f"the robot's recordings, for clients to download (default {recordings_folder()})"
    parser.add_argument("--recordings", metavar="DIR", help=folder)
    add_common(parser)
    # `up` asks before it starts anything.
    parser.add_argument("--check", action="store_true", help=argparse.SUPPRESS)


def settings_of(options: argparse.Namespace, robot: str, config: str | None) -> GatewaySettings:
    """Merge the file and the command line; UserError or ConfigError for a wrong value."""
    found = settings_in(config)
    robots = robots_in(options.robots or ()) or robots_in(found.robots) or [robot]
    systems = dict(map(system_in, options.system)) if options.system else found.systems
    origin = origin_in(*(options.origin or found.origin))
    return replace(
        found,
        endpoints=tuple(options.endpoints or found.endpoints),
        robots=tuple(robots),
        systems=systems_of(robots, systems),
        origin=origin,
        low_rate=options.low_rate or found.low_rate,
        keys=options.signing_keys or found.keys,
    )


def guard_of(settings: GatewaySettings, endpoints: Sequence[EndpointText]) -> SigningGuard:
    """Return the signing of a gateway; UserError if it is required and there is no key."""
    path = Path(settings.keys) if settings.keys else usual_file()
    ring = read_keys(path)
    required = [one.text for one in endpoints if one.policy is Policy.REQUIRE]
    if required and not ring.key:
        fix = "make one with `sidestep keys signing new`"
        raise UserError(f"{required[0]} requires signing, and {path} has no key: {fix}")
    return SigningGuard(
        time.time_ns,
        ring,
        {one.text: one.policy for one in endpoints},
        save=lambda changed: write_keys(path, changed),
        stamps=state_folder() / STAMPS,
        write_stamp=BackgroundWriter(),
    )


def as_gateway(common: Common) -> Common:
    """Return a connection as a person of its own: the clients are not the gateway's user.

    On a locked bus the certificate names it.
    """
    if common.network.tls is not None:
        return common
    return replace(common, network=replace(common.network, person=gateway_here()))


def vehicle_of(port: BusPort, link: RobotLink, settings: GatewaySettings) -> MavVehicle:
    """Return the robot of a port."""
    now_ns = link.clock.now_ns()
    vehicle = MavVehicle(settings.systems[link.name], port, settings.home, now_ns)
    vehicle.origin_altitude_m = settings.altitude_m
    vehicle.unix_offset_ns = time.time_ns() - now_ns
    vehicle.commit = build()["commit"]
    vehicle.guided_timeout_s = settings.guided_timeout_s
    return vehicle


def run(options: argparse.Namespace, output: Output) -> int:
    """Serve until Ctrl-C. Wrong words are errors before the connection to the robot.

    With `--check` only open the endpoints.
    """
    if options.check:
        for endpoint in all_opened([with_policy(text).text for text in options.endpoints]):
            endpoint.close()
        return 0
    common = as_gateway(common_of(options, output))
    settings = settings_of(options, common.robot, common.config)
    texts = [with_policy(text) for text in settings.endpoints]
    guard = guard_of(settings, texts)
    endpoints = all_opened([one.text for one in texts])
    try:
        with open_link(common) as link, StopServer(link):
            return serve(options, link, output, settings, endpoints, guard)
    finally:
        for endpoint in endpoints:
            endpoint.close()


def serve(
    options: argparse.Namespace,
    link: RobotLink,
    output: Output,
    settings: GatewaySettings,
    endpoints: Sequence[Endpoint],
    guard: SigningGuard,
) -> int:
    """Present the robots over a link until Ctrl-C; return 1 if the recording has gaps."""
    recordings = Path(options.recordings) if options.recordings else recordings_folder()
    recorder = recorder_for(options.record, link.clock, output)
    links = [link.to(name) for name in settings.robots]
    ports = [BusPort(one) for one in links]
    vehicles = [vehicle_of(*pair, settings) for pair in zip(ports, links, strict=True)]
    faces = [face_of(vehicle, recordings, guard) for vehicle in vehicles]
    gateway = Gateway(endpoints, faces, ports, link.clock, recorder, guard)
    gateway.line_bytes_s = LOW_RATE_BYTES_S if settings.low_rate else None
    for name, system in settings.systems.items():
        output.note(f"{name} is MAVLink system {system} at {', '.join(settings.endpoints)}")
    for port in ports:
        if not port.was_there:
            output.note(f"robot {port.name} is not running yet, or not at {link.endpoint}")
    with asyncio.Runner() as runner:
        try:
            runner.run(gateway.serve())
        except KeyboardInterrupt:
            output.note("gateway ends")
            runner.run(gateway.finish())
        finally:
            gateway.close()
            for port in ports:
                runner.run(port.close())
    loss = "" if recorder is None else recorder.close()
    if loss:
        output.note(loss)
    return 1 if loss else 0


def recorder_for(place: str | None, clock: Clock, output: Output) -> TrafficRecorder | None:
    """Begin to record the traffic, if that is wanted; UserError if it cannot be."""
    if place is None:
        return None
    offset_ns = time.time_ns() - clock.now_ns()
    recorder = TrafficRecorder(new_file(Path(place)), offset_ns, output.note)
    output.note(f"recording the traffic to {recorder.path}")
    return recorder
