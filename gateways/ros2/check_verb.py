"""`ros2 check`: judge what robots on a ROS 2 network offer, this project's or any other."""

import argparse
import asyncio
import time
from collections.abc import Callable, Sequence
from statistics import median
from typing import TYPE_CHECKING, Any, Final

from gateways.ros2.ros2_verb import MISSING, add_network, environment_of, namespace_of
from ground.commands.command import add_json
from ground.text.output import Output
from runtime.cli.parsers import add_subcommands
from runtime.errors import RemoteError, UserError

if TYPE_CHECKING:
    from gateways.ros2.judge import Finding, JudgeRow, RobotSeen, TopicSeen
    from gateways.ros2.node import RosGraph, RosNode, RosSession
    from gateways.ros2.wire import TokenParts

NODE: Final = "sidestep_check"
SECONDS: Final = 5.0
MAX_SECONDS: Final = 600.0
ROUTER_S: Final = 5.0
QUIET_S: Final = 0.5
GRAPH_S: Final = 5.0
"""The graph is known when nothing has appeared for QUIET_S, or after GRAPH_S."""

ANSWER_S: Final = 3.0
POLL_S: Final = 0.05
MAX_TOPICS: Final = 100
NAME: Final = "list_parameters"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the actions of `ros2`, with their arguments."""
    check = add_subcommands(parser, "ros2")["check"]
    text = "the namespace of the robot; '' for none (default: each that publishes odometry)"
    check.add_argument("--namespace", metavar="NS", help=text)
    text = f"how long topics are received (default {SECONDS:g})"
    check.add_argument("--seconds", type=seconds, default=SECONDS, metavar="S", help=text)
    add_network(check)
    add_json(check)


def seconds(text: str) -> float:
    """Parse the time for which topics are received."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if 0 < value <= MAX_SECONDS:
        return value
    raise argparse.ArgumentTypeError(f"{text!r}: use seconds up to {MAX_SECONDS:g}")


def run(options: argparse.Namespace, output: Output) -> int:
    """Judge the robots; return 1 if a row fails. Raises RemoteError if there is none."""
    try:
        from gateways.ros2 import interfaces, judge, node, wire  # their libraries are optional
    except ModuleNotFoundError as error:
        raise UserError(MISSING.format(error.name)) from None
    environment = environment_of(options)
    domain = node.domain_in(environment)
    config = node.session_config(environment, options.router)
    wanted = None if options.namespace is None else namespace_of("", options.namespace)

    async def observed() -> "list[RobotSeen]":
        session = node.RosSession(interfaces.Interfaces(wire.Distro.JAZZY), config, domain)
        graph, own = node.RosGraph(session), node.RosNode(session, "", NODE)
        session.start()
        try:
            return await observe(session, graph, own, options.seconds, wanted)
        finally:
            await asyncio.to_thread(session.close)

    found = [(robot, judge.judged(robot)) for robot in asyncio.run(observed())]
    is_good = all(one.verdict is not judge.Verdict.FAIL for _, rows in found for _, one in rows)
    robots = [as_dict(robot, rows) for robot, rows in found]
    result: dict[str, object] = {"ok": is_good, "domain": domain, "robots": robots}
    output.result(result, "\n\n".join(as_text(robot, rows) for robot, rows in found))
    return 0 if is_good else 1


async def observe(
    session: "RosSession", graph: "RosGraph", own: "RosNode", passing_s: float, wanted: str | None
) -> "list[RobotSeen]":
    """Return what each robot of the network offers, after so many seconds.

    Raises RemoteError if there is no router, no node, or none that publishes odometry.
    """
    if not await holds(lambda: session.is_linked, ROUTER_S):
        raise RemoteError(
            f"no ROS 2 router at {session.router}: start one with"
            " `ros2 run rmw_zenoh_cpp rmw_zenohd`"
        )
    await settled(lambda: len(graph.entities))
    namespaces = namespaces_of(graph.entities.values())
    if wanted is not None:
        namespaces &= {wanted}
    if not namespaces:
        raise RemoteError(missing_words(session.domain, graph.entities.values(), wanted))
    watching = [watch(own, graph, one, namespaces, passing_s) for one in sorted(namespaces)]
    return list(await asyncio.gather(*watching))


def namespaces_of(entities: "Sequence[TokenParts] | Any") -> set[str]:
    """Return the namespaces in which odometry is published."""
    from gateways.ros2.judge import ODOMETRY
    from gateways.ros2.wire import EntityKind, type_of

    return {
        one.topic.rpartition("/")[0]
        for one in entities
        if one.kind is EntityKind.PUBLISHER and type_of(one.type_in_key) == ODOMETRY
    }


def missing_words(domain: int, entities: "Sequence[TokenParts] | Any", wanted: str | None) -> str:
    """Return why there is nothing to judge."""
    nodes = sorted({one.node for one in entities})
    if not nodes:
        return f"the router is there, but no node in domain {domain}: use --domain for another"
    names = ", ".join(nodes[:10]) + (f" and {len(nodes) - 10} more" if len(nodes) > 10 else "")
    where = "none of them" if wanted is None else f"none in namespace {wanted or '/'}"
    return f"domain {domain} has {names}; {where} publishes nav_msgs/Odometry"


async def watch(
    own: "RosNode", graph: "RosGraph", namespace: str, others: set[str], passing_s: float
) -> "RobotSeen":
    """Receive the topics of a robot for some seconds, and ask two services that change nothing."""
    from gateways.ros2.judge import WATCHED, RobotSeen, Sample, TopicSeen
    from gateways.ros2.wire import EntityKind, type_of
    from ground.ros2.offer import Qos

    entities = {
        gid: parts
        for gid, parts in graph.entities.items()
        if home_of(parts.node, others) == namespace
    }
    robot = RobotSeen(namespace, passing_s, entities, [])
    subscribers = []
    for name, publishers in sorted(robot.of(EntityKind.PUBLISHER).items())[:MAX_TOPICS]:
        type_name = type_of(publishers[0].type_in_key)
        if type_name in WATCHED:
            topic = TopicSeen(name, type_name)
            robot.topics.append(topic)

            def take(message: Any, attachment: Any, topic: TopicSeen = topic) -> None:
                topic.samples.append(Sample(message, attachment, time.time_ns()))

            is_latched = publishers[0].qos.split(":")[1:2] == ["1"]
            qos = Qos(depth=1000, is_latched=is_latched)
            subscribers.append((topic, own.subscribe(name, type_name, take, qos)))
    await asyncio.sleep(passing_s)
    robot.parameters, robot.state = await asyncio.gather(
        parameters_of(own, robot), state_of(own, robot)
    )
    for topic, subscriber in subscribers:
        topic.malformed = subscriber.rejected
    return robot


def home_of(node: str, namespaces: set[str]) -> str:
    """Return the innermost of these namespaces that a node is in."""
    inside = [one for one in namespaces if node.startswith(f"{one}/")]
    return max(inside, key=len, default="?")


async def parameters_of(own: "RosNode", robot: "RobotSeen") -> list[str] | None:
    """Return the names of the parameters of a robot's first node; None without an answer."""
    kind = "rcl_interfaces/srv/ListParameters"
    answer = await asked(own, robot, NAME, kind, [], 0)
    return None if answer is None else [str(name) for name in answer.result.names]


async def state_of(own: "RosNode", robot: "RobotSeen") -> str | None:
    """Return the state of a robot's navigator; None without an answer."""
    answer = await asked(own, robot, "bt_navigator/get_state", "lifecycle_msgs/srv/GetState", 0)
    return None if answer is None else str(answer.current_state.label)


async def asked(own: "RosNode", robot: "RobotSeen", name: str, kind: str, *fields: object) -> Any:
    """Return the answer of the first service of this name; None if there is none."""
    from gateways.ros2.node import RosClient
    from gateways.ros2.wire import EntityKind

    for service in robot.offers(EntityKind.SERVER, name, kind)[:1]:
        client = RosClient(own, service, kind)
        request = own.session.interfaces.make(f"{kind}_Request", *fields)
        return await client.ask(request, ANSWER_S)
    return None


async def holds(condition: Callable[[], object], within_s: float) -> bool:
    """Wait until a condition holds; return False if it does not in time."""
    ends_s = time.monotonic() + within_s
    while not condition():
        if time.monotonic() > ends_s:
            return False
        await asyncio.sleep(POLL_S)
    return True


async def settled(count: Callable[[], int]) -> None:
    """Wait until a number has not changed for a while."""
    ends_s, last, since_s = time.monotonic() + GRAPH_S, count(), time.monotonic()
    while (now_s := time.monotonic()) < ends_s and (not last or now_s - since_s < QUIET_S):
        await asyncio.sleep(POLL_S)
        if (now := count()) != last:
            last, since_s = now, time.monotonic()


# Words.


def topic_words(robot: "RobotSeen", topic: "TopicSeen") -> str:
    """Return rate and age of a topic."""
    from gateways.ros2.judge import ages_s, rate_hz

    if len(topic.samples) < 2:
        return f"{len(topic.samples)} received"
    ages = ages_s(robot, topic)
    return f"{rate_hz(topic):.1f} Hz" + (f", {1000 * median(ages):.0f} ms old" if ages else "")


def as_text(robot: "RobotSeen", rows: "Sequence[tuple[JudgeRow, Finding]]") -> str:
    """Return the topics that were received, and a line for each row."""
    lines = [f"{robot.namespace or '/'}: received for {robot.seconds:g} s"]
    for topic in robot.topics:
        name = f"  {topic.name:<24} {topic.type_name:<36}"
        lines.append(printable(f"{name} {topic_words(robot, topic)}"))
    for number, (row, (verdict, evidence)) in enumerate(rows, 1):
        lines.append(printable(f"{number:>3}  {verdict:<12} {row.title}: {evidence}"))
    verdicts = [one.verdict for _, one in rows]
    counts = [f"{verdicts.count(one)} {one}" for one in dict.fromkeys(sorted(verdicts))]
    return "\n".join([*lines, f"{len(rows)} rows: {', '.join(counts)}"])


def as_dict(robot: "RobotSeen", rows: "Sequence[tuple[JudgeRow, Finding]]") -> dict[str, object]:
    """Return the same as a JSON object."""
    from gateways.ros2.judge import ages_s, rate_hz

    return {
        "namespace": robot.namespace or "/",
        "topics": [
            {
                "topic": topic.name,
                "type": topic.type_name,
                "samples": len(topic.samples),
                "rate_hz": round(rate_hz(topic), 2),
                "age_ms": round(1000 * median(ages)) if (ages := ages_s(robot, topic)) else None,
            }
            for topic in robot.topics
        ],
        "rows": [
            {"row": number, "title": row.title, "verdict": verdict, "evidence": evidence}
            for number, (row, (verdict, evidence)) in enumerate(rows, 1)
        ],
    }


def printable(text: str) -> str:
    """Replace unprintable characters that a node has sent."""
    return "".join(one if one.isprintable() else "?" for one in text)
