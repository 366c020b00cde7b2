"""`gateway`: present the robot to MAVLink ground stations, until a signal ends it."""

import argparse

from ground.client.link import Link
from ground.gateway.bus_port import BusPort
from ground.gateway.endpoints.spec import EXAMPLE, opened
from ground.gateway.gateway import Gateway, WakeUp
from ground.gateway.services import face_of
from ground.gateway.vehicle import Vehicle
from ground.grammar.words import add_common
from ground.missions.mission import Home
from ground.text.output import Output

SYSTEM = 1


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `gateway`."""
    text = "where clients connect: udpin:HOST:PORT or udpout:HOST:PORT; several are possible"
    parser.add_argument("endpoints", nargs="*", default=[EXAMPLE], metavar="ENDPOINT", help=text)
    add_common(parser)


def act(options: argparse.Namespace, link: Link, output: Output) -> int:
    """Serve until Ctrl-C."""
    wake_up = WakeUp()
    port = BusPort(link, wake_up.wake)
    endpoints = [opened(text) for text in options.endpoints]
    origin = Home(latitude_deg=0.0, longitude_deg=0.0)
    face = face_of(Vehicle(SYSTEM, port, origin, link.clock.now_ns()))
    gateway = Gateway(endpoints, [face], [port], link.clock, wake_up)
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
