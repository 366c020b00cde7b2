"""`gateway`: present robots to MAVLink ground stations, until a signal ends it."""

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from gateways.mavlink.bus_port import BusPort
from gateways.mavlink.endpoints.endpoint import Endpoint
from gateways.mavlink.endpoints.recorder import TrafficRecorder, new_file
from gateways.mavlink.endpoints.spec import EXAMPLE, all_opened
from gateways.mavlink.gateway import Gateway, WakeUp
from gateways.mavlink.services import face_of
from gateways.mavlink.settings import (
    LOW_RATE_BYTES_S,
    EndpointText,
    GatewaySettings,
    origin_in,
    robots_in,
    settings_in,
    system_in,
    systems_of,
    with_policy,
)
from gateways.mavlink.signing.guard import SigningGuard
from gateways.mavlink.signing.policy import Policy
from gateways.mavlink.signing.stamps import BackgroundWriter
from gateways.mavlink.vehicle import Vehicle
from ground.cli.options import common_of
from ground.client.connection import Common
from ground.client.link import Link, open_link
from ground.client.stop_ways import StopServer
from ground.grammar.words import add_common
from ground.recording.build_info import build
from ground.text.output import Output
from ground.user.folders import recordings_folder, state_folder
from ground.user.mavlink_keys import read_keys, usual_file, write_keys
from protocol.bus.network import gateway_here
from protocol.options import finite
from runtime.clock import Clock
from runtime.errors import UserError

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


def vehicle_of(port: BusPort, link: Link, settings: GatewaySettings) -> Vehicle:
    """Return the robot of a port."""
    now_ns = link.clock.now_ns()
    vehicle = Vehicle(settings.systems[link.robot], port, settings.home, now_ns)
    vehicle.origin_altitude_m = settings.altitude_m
    vehicle.unix_offset_ns = time.time_ns() - now_ns
    vehicle.commit = build()["commit"]
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
    link: Link,
    output: Output,
    settings: GatewaySettings,
    endpoints: Sequence[Endpoint],
    guard: SigningGuard,
) -> int:
    """Present the robots over a link until Ctrl-C; return 1 if the recording has gaps."""
    wake_up = WakeUp()
    recordings = Path(options.recordings) if options.recordings else recordings_folder()
    recorder = recorder_for(options.record, link.clock, output)
    links = [link.to(name) for name in settings.robots]
    ports = [BusPort(one, wake_up.wake) for one in links]
    vehicles = [vehicle_of(*pair, settings) for pair in zip(ports, links, strict=True)]
    faces = [face_of(vehicle, recordings, guard) for vehicle in vehicles]
    gateway = Gateway(endpoints, faces, ports, link.clock, wake_up, recorder, guard)
    gateway.line_bytes_s = LOW_RATE_BYTES_S if settings.low_rate else None
    for name, system in settings.systems.items():
        output.note(f"{name} is MAVLink system {system} at {', '.join(settings.endpoints)}")
    for port in ports:
        if not port.was_there:
            output.note(f"robot {port.name} is not running yet, or not at {link.endpoint}")
    try:
        gateway.run()
    except KeyboardInterrupt:
        output.note("gateway ends")
        gateway.finish()
    finally:
        gateway.close()
        for port in ports:
            port.close()
        wake_up.close()
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
