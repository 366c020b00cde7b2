"""`gateway`: present the robot to MAVLink ground stations, until a signal ends it."""

import argparse
import time
from pathlib import Path

from ground.client.link import Link
from ground.gateway.bus_port import BusPort
from ground.gateway.endpoints.recorder import TrafficRecorder, new_file
from ground.gateway.endpoints.spec import EXAMPLE, all_opened
from ground.gateway.frames.globe import DEFAULT_ALTITUDE_M, DEFAULT_ORIGIN
from ground.gateway.gateway import Gateway, WakeUp
from ground.gateway.services import face_of
from ground.gateway.vehicle import Vehicle
from ground.grammar.words import add_common
from ground.recording.build_info import build
from ground.text.output import Output
from ground.user.folders import recordings_folder
from runtime.clock import Clock

SYSTEM = 1
RECORD_HELP = "record all traffic to a new .tlog with this name, or in this folder"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `gateway`."""
    text = (
        "where clients connect: udpin:HOST:PORT, udpout:HOST:PORT, tcpin:HOST:PORT or"
        " serial:DEVICE:BAUD; several are possible"
    )
    parser.add_argument("endpoints", nargs="*", default=[EXAMPLE], metavar="ENDPOINT", help=text)
    parser.add_argument("--record", metavar="FILE", help=RECORD_HELP)
    folder = f"the robot's recordings, for clients to download (default {recordings_folder()})"
    parser.add_argument("--recordings", metavar="DIR", help=folder)
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
    endpoints = all_opened(options.endpoints)
    wake_up = WakeUp()
    port = BusPort(link, wake_up.wake)
    vehicle = vehicle_of(port, link)
    recordings = Path(options.recordings) if options.recordings else recordings_folder()
    recorder = recorder_for(options.record, link.clock, output)
    faces = [face_of(vehicle, recordings)]
    gateway = Gateway(endpoints, faces, [port], link.clock, wake_up, recorder)
    output.note(f"{link.robot} is MAVLink system {SYSTEM} at {', '.join(options.endpoints)}")
    try:
        gateway.run()
    except KeyboardInterrupt:
        output.note("gateway ends")
    finally:
        gateway.close()
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
    recorder = TrafficRecorder(new_file(Path(place)), offset_ns)
    output.note(f"recording the traffic to {recorder.path}")
    return recorder
