"""`run ros2`: present robots as ROS 2 nodes, until a signal ends it."""

import argparse
import asyncio
import os
import re
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Final

from ground.cli.options import common_of
from ground.client.connection import Common
from ground.client.robot_link import open_link
from ground.client.stop_ways import StopServer
from ground.commands.command import add_common
from ground.launch.recording_session import add_keep
from ground.ros2.offer import NODE, own_namespace
from ground.text.output import Output
from protocol.bus.network import with_digits
from protocol.topics import robot_names
from runtime.errors import UserError

PERSON: Final = "ros2"

NAMESPACE: Final = re.compile(r"/?([A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*)?\Z")
MISSING: Final = "the ROS 2 gateway needs {}, which is not installed: pip install 'sidestep[ros2]'"
DISTROS: Final = "jazzy, kilted, lyrical"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `ros2`."""
    text = "the robots to present, as in r1,r2 (default: that of --id)"
    parser.add_argument("--robots", metavar="NAMES", help=text)
    text = "namespace of the only robot instead of its name; '' for none"
    parser.add_argument("--namespace", metavar="NS", help=text)
    text = f"distribution of ROS 2 on the network: {DISTROS} (default: the keys of all three)"
    parser.add_argument("--distro", metavar="D", help=text)
    add_network(parser)
    text = (
        "take nothing from the ROS 2 network but the emergency stop; the default on a locked bus,"
        " because a ROS 2 network has no locks"
    )
    parser.add_argument("--read-only", action=argparse.BooleanOptionalAction, help=text)
    parser.add_argument("--scan", action="store_true", help="also the sonars as a LaserScan")
    text = "also write what is published as bags of ROS 2, each in a new folder below DIR"
    parser.add_argument("--record", metavar="DIR", help=text)
    add_keep(parser)
    add_common(parser)


def add_network(parser: argparse.ArgumentParser) -> None:
    """Declare where the ROS 2 network is."""
    text = (
        "the router of the ROS 2 network (default: as ZENOH_SESSION_CONFIG_URI or"
        " ZENOH_CONFIG_OVERRIDE say, else tcp/localhost:7447)"
    )
    parser.add_argument("--router", metavar="ENDPOINT", help=text)
    text = "the domain, instead of ROS_DOMAIN_ID"
    parser.add_argument("--domain", metavar="N", help=text)


def environment_of(options: argparse.Namespace) -> dict[str, str]:
    """Return the environment with the domain of the options."""
    given = {} if options.domain is None else {"ROS_DOMAIN_ID": options.domain}
    return {**os.environ, **given}


def as_ros2(common: Common) -> Common:
    """Return a connection as a person of its own: ROS 2 clients are not the gateway's user.

    On a locked bus the certificate names it.
    """
    if common.network.tls is not None:
        return common
    return replace(common, network=replace(common.network, person=with_digits(PERSON)))


def namespace_of(robot: str, given: str | None) -> str:
    """Return the namespace of a robot, absolute or empty; UserError for one that ROS refuses."""
    if given is None:
        return own_namespace(robot)
    if not NAMESPACE.match(given):
        raise UserError(f"--namespace {given!r}: use letters, digits and _, as in r1 or fleet/r1")
    return f"/{given.strip('/')}" if given.strip("/") else ""


def run(options: argparse.Namespace, output: Output) -> int:
    """Serve until Ctrl-C. Wrong words are errors before the connection to the robot."""
    try:
        from gateways.ros2 import (  # their libraries are optional
            face,
            interfaces,
            node,
            recorder,
            wire,
        )
    except ModuleNotFoundError as error:
        raise UserError(MISSING.format(error.name)) from None
    distros = list(wire.Distro)
    if options.distro is not None:
        distros = [wire.distro_named(options.distro)]
    common = as_ros2(common_of(options, output))
    names = [common.robot] if options.robots is None else robot_names("--robots", options.robots)
    if options.keep is not None and options.record is None:
        raise UserError("--keep needs --record DIR")
    if options.namespace is not None and len(names) > 1:
        raise UserError(f"--namespace {options.namespace!r} is for one robot, not {len(names)}")
    environment = environment_of(options)
    domain = node.domain_in(environment)
    config = node.session_config(environment, options.router)
    is_locked = common.network.tls is not None
    settings = {
        name: face.FaceSettings(
            namespace=namespace_of(name, options.namespace),
            read_only=is_locked if options.read_only is None else options.read_only,
            scan=options.scan,
        )
        for name in names
    }
    bag: recorder.BagRecorder | None = None
    with ExitStack() as stack:
        link = stack.enter_context(open_link(common))
        stack.enter_context(StopServer(link))
        if options.record is not None:
            bag = recorder.BagRecorder(Path(options.record), options.keep, output)
            stack.enter_context(bag)  # ends when the faces have ended
        runner = stack.enter_context(asyncio.Runner())
        for name, one in settings.items():
            output.note(f"{name} is the ROS 2 node {one.namespace}/{NODE} in domain {domain}")

        async def serve() -> None:
            first, *others = map(interfaces.Interfaces, distros)
            record = None if bag is None else bag.take
            session = node.RosSession(first, config, domain, output.note, others, record)
            await face.present(link, session, settings, output.note)

        try:
            runner.run(serve())
        except KeyboardInterrupt:
            output.note("ros2 ends")
    return 0 if bag is None or bag.is_complete else 1
