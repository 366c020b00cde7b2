"""`health ROLE`: 0 when what that role says is heard within its stale-after, else 1 and why.

For health checks of containers: a process whose loop hangs is there, and is not healthy.
"""

import argparse
from collections.abc import Mapping
from contextlib import closing
from http.client import HTTPConnection, HTTPException
from types import MappingProxyType
from typing import Any, Final

from ground.client.link import Link, UnansweredError
from ground.client.presence import present_processes
from ground.grammar.words import add_common
from ground.text.output import Output
from ground.web.address import Address, address_of
from protocol.bus.network import Hub
from protocol.topics import HEARTBEAT, SONAR, STATUS, WHEELS, Role, Topic
from runtime.units import NS_PER_MS

ROUTER: Final = "router"
SIGNS: Final[Mapping[str, tuple[Topic[Any], ...]]] = MappingProxyType(
    {
        Role.ROBOT.value: (HEARTBEAT, STATUS),
        Role.PLANT.value: (WHEELS, SONAR),
        ROUTER: (),
        Role.GROUND.value: (HEARTBEAT,),
    }
)
"""What is heard when a role is well: of the ground station, that the robot's heart reaches it."""

GRACE_NS: Final = 300_000_000
"""For the others to learn that somebody listens."""

PAGE_S: Final = 2.0


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("role", choices=list(SIGNS), metavar="ROLE", help=", ".join(SIGNS))
    add_common(parser)
    parser.add_argument(
        "--web", metavar="HOST:PORT", help="of ground: does the page for browsers answer, too?"
    )


def run(options: argparse.Namespace, says: Output) -> int:
    """Raises UnansweredError, which has exit code 1, with the reason."""
    if options.web is not None:
        ask_page(address_of(options.web))
    from ground.cli.verbs import talking  # which knows this verb

    return talking(act)(options, says)


def act(options: argparse.Namespace, link: Link, says: Output) -> int:
    """The same over a link that is there."""
    hub = link.bus.hub()
    if options.role == ROUTER and hub is not Hub.ROUTER:
        raise UnansweredError(f"at {link.endpoint} is {hub.value}, no router")
    listen(options.role, link)
    found: dict[str, object] = {"role": options.role, "robot": link.robot, "ok": True}
    says.result(found, f"{options.role}: healthy")
    return 0


def listen(role: str, link: Link) -> None:
    """Raise UnansweredError for the first of its topics that is not heard in time."""
    signs = SIGNS[role]
    if not signs:
        return
    limit_ns = max(topic.stale_after_ns for topic in signs)
    with link.subscribed(*signs) as telemetry:
        link.wait(lambda: all(map(telemetry.latest, signs)), limit_ns + GRACE_NS)
        for topic in signs:
            if telemetry.latest(topic) is None:
                box = telemetry.boxes()[topic.path]
                raise UnansweredError(unheard(role, topic, box.last_rejection, link))


def unheard(role: str, topic: Topic[Any], rejection: str, link: Link) -> str:
    """What is missing, and what is known about why."""
    if rejection:
        return f"{topic.path} of {link.robot} {rejection}"
    within_ms = (topic.stale_after_ns + GRACE_NS) // NS_PER_MS
    what = f"nothing on {topic.path} of {link.robot} within {within_ms} ms"
    if role != Role.PLANT.value:
        return f"{what}: {link.diagnosis()}"
    carried = present_processes(link.bus.present()).has(link.robot, Role.PLANT)
    return f"{what}: {'the plant hangs or is paused' if carried else 'no plant carries it'}"


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
        raise UnansweredError(f"the page at {where} is broken: status {status}")
