"""`gateway`: present the robot to MAVLink ground stations, until a signal ends it."""

import argparse
import time

from ground.client.link import Link
from ground.gateway.bus_port import BusPort
from ground.gateway.endpoints.spec import EXAMPLE, opened
from ground.gateway.frames.globe import DEFAULT_ALTITUDE_M, DEFAULT_ORIGIN
from ground.gateway.gateway import Gateway, WakeUp
from ground.gateway.services import face_of
from ground.gateway.vehicle import Vehicle
from ground.grammar.words import add_common
from ground.recording.build_info import build
from ground.text.output import Output

SYSTEM = 1


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `gateway`."""
    text = "where clients connect: udpin:HOST:PORT or udpout:HOST:PORT; several are possible"
    parser.add_argument("endpoints", nargs="*", default=[EXAMPLE], metavar="ENDPOINT", help=text)
    add_common(parser)


def vehicle_of(port: BusPort, link: Link) -> Vehicle:
    """Return the robot of a port at the default origin."""
    now_ns = link.clock.now_ns()
    vehicle = Vehicle(SYSTEM, port, DEFAULT_ORIGIN, now_ns)
    vehicle.origin_altitude_m = DEFAULT_ALTITUDE_M
    vehicle.unix_offset_ns = time.time_ns() - now_ns
    vehicle.commit = build()["commit"]
    return vehicle


def act(options: argparse.Namespace, link: Link, output: Output) -> int:
    """Serve until Ctrl-C."""
    wake_up = WakeUp()
    port = BusPort(link, wake_up.wake)
    endpoints = [opened(text) for text in options.endpoints]
    gateway = Gateway(endpoints, [face_of(vehicle_of(port, link))], [port], link.clock, wake_up)
    output.note(f"{link.robot} is MAVLink system {SYSTEM} at {', '.join(options.endpoints)}")
    try:
        gateway.run()
    except KeyboardInterrupt:
        output.note("gateway ends")
    finally:
        gateway.close()
        port.close()
        wake_up.close()
    return 0
