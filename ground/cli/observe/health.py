"""`health ROLE`: exit code 0 if the role publishes its data in time, else 1 with the reason.

For the health checks of containers: a process whose loop hangs is present, but not healthy.
"""

import argparse
from collections.abc import Mapping
from contextlib import closing
from http.client import HTTPConnection, HTTPException
from types import MappingProxyType
from typing import Any, Final

from ground.cli.operate import run_until_signal
from ground.cli.options import common_of
from ground.client.robot_link import RobotLink, UnansweredError, open_link
from ground.commands.command import add_common
from ground.text.output import Output
from ground.web import Address, address_of
from protocol.bus.network import Hub
from protocol.topics import HEARTBEAT, SONAR, STATUS, WHEELS, Role, Topic
from runtime.units import NS_PER_MS

ROUTER: Final = "router"
TOPICS_OF_ROLE: Final[Mapping[str, tuple[Topic[Any], ...]]] = MappingProxyType(
    {
        Role.ROBOT.value: (HEARTBEAT, STATUS),
        Role.PLANT.value: (WHEELS, SONAR),
        ROUTER: (),
        Role.GROUND.value: (HEARTBEAT,),
    }
)
"""The topics that a healthy role publishes; for ground, that the robot's heartbeat arrives."""

GRACE_NS: Final = 300_000_000
"""Time for publishers to discover the new subscriber."""

PAGE_S: Final = 2.0


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `health`."""
    parser.add_argument(
        "role", choices=list(TOPICS_OF_ROLE), metavar="ROLE", help=", ".join(TOPICS_OF_ROLE)
    )
    add_common(parser)
    parser.add_argument("--web", metavar="HOST:PORT", help="for ground: check the web page too")


def run(options: argparse.Namespace, output: Output) -> int:
    """Check the web page if requested, then the topics of the role.

    Raises UnansweredError, whose exit code is 1, with the reason.
    """
    if options.web is not None:
        ask_page(address_of(options.web))
    with open_link(common_of(options, output)) as link:
        hub = link.bus.hub()
        if options.role == ROUTER and hub is not Hub.ROUTER:
            raise UnansweredError(f"the process at {link.endpoint} is {hub.value}, not a router")
        run_until_signal(lambda: listen(options.role, link))
        found: dict[str, object] = {"role": options.role, "robot": link.name, "ok": True}
    output.result(found, f"{options.role}: healthy")
    return 0


async def listen(role: str, link: RobotLink) -> None:
    """Raise UnansweredError for the first topic of the role that does not arrive in time."""
    topics = TOPICS_OF_ROLE[role]
    if not topics:
        return
    limit_ns = max(topic.stale_after_ns for topic in topics)
    with link.subscribed(*topics) as telemetry:
        await link.wait(lambda: all(map(telemetry.latest, topics)), limit_ns + GRACE_NS)
        for topic in topics:
            if telemetry.latest(topic) is None:
                box = telemetry.boxes()[topic.path]
                why = await missing_topic(role, topic, box.last_rejection, link)
                raise UnansweredError(why)


async def missing_topic(role: str, topic: Topic[Any], rejection: str, link: RobotLink) -> str:
    """Return the topic that is missing, and the reason if it is known."""
    if rejection:
        return f"{topic.path} of {link.name} {rejection}"
    within_ms = (topic.stale_after_ns + GRACE_NS) // NS_PER_MS
    what = f"no message on {topic.path} of {link.name} within {within_ms} ms"
    if role != Role.PLANT.value:
        return f"{what}: {await link.diagnosis()}"
    processes = await link.in_own_thread(link.processes)
    has_plant = processes.has(link.name, Role.PLANT)
    return (
        f"{what}: {'the plant is slow, hangs or is paused' if has_plant else 'no plant is running'}"
    )


def ask_page(address: Address) -> None:
    """Raise UnansweredError unless a web server answers there; the token is not needed."""
    where = f"http://{address.host}:{address.port}/"
    try:
        with closing(HTTPConnection(address.host, address.port, timeout=PAGE_S)) as connection:
            connection.request("GET", "/")
            status = connection.getresponse().status
    except (OSError, HTTPException) as error:
        raise UnansweredError(f"no page at {where}: {error}") from error
    if status >= 500:
        raise UnansweredError(f"the page at {where} fails with status {status}")
