"""`watch`: print telemetry and texts as lines, or the state once."""

from ground.client.outcomes import Report
from ground.client.robot_link import LISTEN_NS
from ground.client.status_line import watch_line
from ground.client.telemetry import SUMMARY_TOPICS, Telemetry
from ground.commands.command import OperatorCommand, command, switch
from ground.robot import Robot
from ground.text.wording import in_words
from protocol.topics import STATUS
from runtime.cli.verb import LOOK
from runtime.units import NS_PER_S


@command(LOOK, 10, "watch --once")
class Watch(OperatorCommand):
    """Print telemetry and texts as lines.

    A program that shows lines all the time does so itself; this reads every stream once.
    """

    once: bool = switch(
        "--once", default=False, help="print the state once, as --json does", after="json"
    )

    @property
    def is_live(self) -> bool:
        """True if it shows the state all the time, unless as JSON."""
        return not self.once

    async def perform(self, robot: Robot) -> Report:
        """Report the state as soon as all streams have arrived, or after 0.7 s.

        It is `ok` if the robot's status arrives.
        """
        with robot.subscribed(*SUMMARY_TOPICS) as telemetry:
            await robot.wait(lambda: all(map(telemetry.latest, SUMMARY_TOPICS)), LISTEN_NS)
            now_ns = robot.clock.now_ns()
            has_status = telemetry.live(STATUS, now_ns) is not None
            row = {"robot": robot.name, "ok": has_status, **snapshot(telemetry, now_ns)}
            text = in_words(watch_line(telemetry, now_ns))
            if not has_status:
                row["reason"] = await robot.diagnosis()
                text = f"{text}\n{row['reason']}"
            return Report(has_status, text, row)


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
