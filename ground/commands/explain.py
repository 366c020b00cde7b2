"""`explain`: explain a decision of a robot, live or at an instant of a recording."""

from dataclasses import field, replace
from pathlib import Path
from typing import Any, Final, Self

from ground.client.outcomes import Progress, Report
from ground.client.robot_link import LISTEN_NS
from ground.commands.command import (
    OperatorCommand,
    Reach,
    command,
    moment,
    option,
    parsed,
    place,
    switch,
)
from ground.commands.recordings import SUFFIXES
from ground.explain import Explanation, RecordedDecisions, Turn, explain
from ground.recording.catalogue import recording_named, recordings_in, remark_on
from ground.recording.log_reader import LogIndex, open_log
from ground.robot import Robot
from ground.user.folders import recordings_folder
from protocol.topics import CYCLE, DECISION, STATUS
from runtime.cli.verb import LOOK
from runtime.errors import UserError
from runtime.units import NS_PER_S

NEXT_NS: Final = 200_000_000


@command(LOOK, 40, "explain drive.mcap --at 12.5", suffixes=SUFFIXES)
class Explain(OperatorCommand):
    """Show why the robot turns, live or in a recording.

    Of a recording it is the decision at a second, or at its last turning point; `turns` lists the
    turning points instead. `robot`: the robot, if the file has several. `remark` is what is said
    about the choice of the file first.
    """

    file: str | None = place(
        "FILE", "a recording, as for replay; without --at and --turns the robot, now", default=None
    )
    at_s: float | None = option(
        "--at",
        default=None,
        parse=moment,
        metavar="S",
        help="seconds of the recording (default the last turning point)",
    )
    turns: bool = switch("--turns", default=False, help="list its turning points")
    robot: str | None = None
    remark: str = field(default="", compare=False)

    @classmethod
    def parsed(cls, found: Any) -> Self:
        """Return the command; with --at or --turns that for the newest finished recording."""
        if found.file is None and found.at_s is None and not found.turns:
            return parsed(cls, found)
        path = recording_named(found.file)
        known = {"file": str(path), "remark": remark_on(path, found.file)}
        return parsed(cls, found, robot=found.id, **known)

    @property
    def is_offline(self) -> bool:
        """True for a recording."""
        return self.file is not None

    def without_robot(self, reach: Reach) -> Self | None:
        """Return what is done instead when no robot was named and none answers, if anything."""
        named = (reach.connect, reach.config, reach.run, reach.id)
        if any(word is not None for word in named) or not recordings_in(recordings_folder()):
            return None
        path = recording_named(None)
        return replace(self, file=str(path), remark=remark_on(path, None))

    def run(self, progress: Progress) -> Report:
        """Explain a recorded decision; UserError if none is recorded up to then."""
        if self.remark:
            progress.note(self.remark)
        return of_a_recording(self, str(self.file), progress)

    async def perform(self, robot: Robot) -> Report:
        """Explain the next decision that arrives."""
        with robot.subscribed(STATUS, DECISION, CYCLE) as telemetry:
            await robot.wait(lambda: telemetry.latest(DECISION) is not None, LISTEN_NS)
            before = telemetry.latest(DECISION)
            if before is None:
                why = await robot.diagnosis()
                return Report(False, why, {"robot": robot.name, "ok": False, "reason": why})
            await robot.wait(lambda: telemetry.latest(DECISION) != before, NEXT_NS)
            await robot.wait(lambda: telemetry.latest(STATUS) is not None, NEXT_NS)
            now_ns = robot.clock.now_ns()
            decision, status = telemetry.live(DECISION, now_ns), telemetry.live(STATUS, now_ns)
            found = explain(decision, status, telemetry.live(CYCLE, now_ns), before[0])
            return Report(True, found.text(), {"robot": robot.name, "ok": True, **as_json(found)})


def of_a_recording(asked: Explain, file: str, progress: Progress) -> Report:
    """Explain a recorded decision; UserError if none is recorded up to then.

    The report is `ok` unless the recording is damaged.
    """
    log_index = LogIndex(open_log(Path(file), asked.robot))
    if log_index.damage:
        progress.note(f"{file}: DAMAGED: {log_index.damage}")
    recorded = RecordedDecisions(log_index)
    turns = list(recorded.turns())
    if asked.turns:
        return turns_of(file, turns)
    at_ns = chosen_ns(asked.at_s, file, log_index, turns)
    decision = recorded.at(at_ns)
    if decision is None:
        raise UserError(f"{file}: no decision is recorded up to {at_ns / NS_PER_S:g} s")
    decided_ns, found = decision
    at_s = decided_ns / NS_PER_S
    row = {"file": file, "ok": True, "at_s": at_s, **as_json(found)}
    return Report(not log_index.damage, f"at {at_s:.2f} s it {found.text()}", row)


def chosen_ns(at_s: float | None, file: str, log_index: LogIndex, turns: list[Turn]) -> int:
    """Return the requested instant, else the last turning point, else the end."""
    if at_s is not None:
        return instant_ns(file, log_index, at_s)
    return turns[-1].at_ns if turns else log_index.duration_ns


def instant_ns(file: str, log_index: LogIndex, at_s: float) -> int:
    """Convert seconds to ns of the recording; UserError if it ends before."""
    at_ns = round(at_s * NS_PER_S)
    if at_ns > log_index.duration_ns:
        raise UserError(
            f"{file} ends at {log_index.duration_ns / NS_PER_S:.2f} s, before {at_s:g} s"
        )
    return at_ns


def turns_of(file: str, turns: list[Turn]) -> Report:
    """List the turning points."""
    rows = [{"at_s": turn.at_ns / NS_PER_S, "changed": turn.words} for turn in turns]
    lines = [f"{turn.at_ns / NS_PER_S:8.2f} s  {turn.words}" for turn in turns]
    text = "\n".join(lines) if lines else "the decision never changed"
    return Report(True, text, {"file": file, "ok": True, "turns": rows})


def as_json(found: Explanation) -> dict[str, object]:
    """Return headline and lines as a row."""
    pairs = [line.split(maxsplit=1) for line in found.lines]
    return {"headline": found.headline, "lines": dict(pairs)}
