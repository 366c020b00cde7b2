"""The present state of a robot: every stream once, with its age."""

from dataclasses import dataclass
from typing import ClassVar

from ground.client.link import LISTEN_NS, Link
from ground.client.outcomes import Report
from ground.client.session import Session
from ground.client.status_line import watch_line
from ground.client.telemetry import SUMMARY_TOPICS, Telemetry
from ground.text.status_parts import in_words
from protocol.topics import STATUS
from runtime.units import NS_PER_S


@dataclass(frozen=True, slots=True, kw_only=True)
class LookOnce:
    """Read every stream once; `ok` if the robot's status arrives."""

    verb: ClassVar[str] = "watch"
    moves: ClassVar[bool] = False

    def perform(self, session: Session) -> Report:
        """Wait for the streams and report them."""
        with session.link.subscribed(*SUMMARY_TOPICS) as telemetry:
            return look(session.link, telemetry)


def look(link: Link, telemetry: Telemetry) -> Report:
    """Report the state as soon as all streams have arrived, or after 0.7 s."""
    link.wait(lambda: all(telemetry.latest(topic) for topic in SUMMARY_TOPICS), LISTEN_NS)
    now_ns = link.clock.now_ns()
    has_status = telemetry.live(STATUS, now_ns) is not None
    found = snapshot(telemetry, now_ns)
    text = in_words(watch_line(telemetry, now_ns))
    if not has_status:
        why = link.diagnosis()
        found |= {"reason": why}
        text = f"{text}\n{why}"
    return Report(has_status, text, {"robot": link.robot, "ok": has_status, **found})


def snapshot(telemetry: Telemetry, now_ns: int) -> dict[str, object]:
    """Return every stream with its age; a value that is too old is null."""
    streams: dict[str, object] = {}
    for topic in SUMMARY_TOPICS:
        seen = telemetry.seen(topic, now_ns)
        message = telemetry.live(topic, now_ns)
        names = () if message is None else message.__struct_fields__
        streams[topic.path] = {
            "age_s": None if seen.age_ns is None else seen.age_ns / NS_PER_S,
            "state": seen.age.value,
            "message": {name: getattr(message, name) for name in names} or None,
        }
    return {"streams": streams}
