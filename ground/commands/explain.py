"""`explain`: explain a decision of a robot, live or at an instant of a recording."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Final

from ground.client.link import LISTEN_NS, Link
from ground.client.outcomes import Progress, Report
from ground.client.session import Session
from ground.client.telemetry import Telemetry
from ground.explain.explanation import Explanation, explain
from ground.explain.turns import Recorded, Turn
from ground.recording.log_reader import LogIndex, open_log
from protocol.topics import CYCLE, DECISION, STATUS
from runtime.errors import UserError
from runtime.units import NS_PER_S

NEXT_NS: Final = 200_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplainNow:
    """Explain the robot's next decision."""

    verb: ClassVar[str] = "explain"
    moves: ClassVar[bool] = False

    def perform(self, session: Session) -> Report:
        """Wait for the next decision and explain it."""
        with session.link.subscribed(STATUS, DECISION, CYCLE) as telemetry:
            return of_a_robot(session.link, telemetry)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExplainRecording:
    """Explain the decision at a second of a recording, or at its last turning point.

    `turns`: list the turning points instead. `robot`: the robot, if the file has several.
    """

    verb: ClassVar[str] = "explain"
    moves: ClassVar[bool] = False
    file: str
    at_s: float | None = None
    turns: bool = False
    robot: str | None = None

    def run(self, progress: Progress) -> Report:
        """Explain without a robot."""
        return of_a_recording(self, progress)

    def perform(self, session: Session) -> Report:
        """Explain without using the session's robot."""
        return self.run(session.progress)


def of_a_robot(link: Link, telemetry: Telemetry) -> Report:
    """Explain the next decision that arrives."""
    link.wait(lambda: telemetry.latest(DECISION) is not None, LISTEN_NS)
    before = telemetry.latest(DECISION)
    if before is None:
        why = link.diagnosis()
        return Report(False, why, {"robot": link.robot, "ok": False, "reason": why})
    link.wait(lambda: telemetry.latest(DECISION) != before, NEXT_NS)
    link.wait(lambda: telemetry.latest(STATUS) is not None, NEXT_NS)
    now_ns = link.clock.now_ns()
    decision, status = telemetry.live(DECISION, now_ns), telemetry.live(STATUS, now_ns)
    found = explain(decision, status, telemetry.live(CYCLE, now_ns), before[0])
    return Report(True, found.text(), {"robot": link.robot, "ok": True, **as_json(found)})


def of_a_recording(asked: ExplainRecording, progress: Progress) -> Report:
    """Explain a recorded decision; UserError if none is recorded up to then.

    The report is `ok` unless the recording is damaged.
    """
    log_index = LogIndex(open_log(Path(asked.file), asked.robot))
    if log_index.damage:
        progress.note(f"{asked.file}: DAMAGED: {log_index.damage}")
    recorded = Recorded(log_index)
    turns = list(recorded.turns())
    if asked.turns:
        return turns_of(asked, turns)
    at_ns = chosen_ns(asked, log_index, turns)
    decision = recorded.at(at_ns)
    if decision is None:
        raise UserError(f"{asked.file}: no decision is recorded up to {at_ns / NS_PER_S:g} s")
    decided_ns, found = decision
    at_s = decided_ns / NS_PER_S
    row = {"file": asked.file, "ok": True, "at_s": at_s, **as_json(found)}
    return Report(not log_index.damage, f"at {at_s:.2f} s it {found.text()}", row)


def chosen_ns(asked: ExplainRecording, log_index: LogIndex, turns: list[Turn]) -> int:
    """Return the requested instant, else the last turning point, else the end."""
    if asked.at_s is not None:
        return instant_ns(asked.file, log_index, asked.at_s)
    return turns[-1].at_ns if turns else log_index.duration_ns


def instant_ns(file: str, log_index: LogIndex, at_s: float) -> int:
    """Convert seconds to ns of the recording; UserError if it ends before."""
    at_ns = round(at_s * NS_PER_S)
    if at_ns > log_index.duration_ns:
        raise UserError(
            f"{file} ends at {log_index.duration_ns / NS_PER_S:.2f} s, before {at_s:g} s"
        )
    return at_ns


def turns_of(asked: ExplainRecording, turns: list[Turn]) -> Report:
    """List the turning points."""
    rows = [{"at_s": turn.at_ns / NS_PER_S, "changed": turn.words} for turn in turns]
    lines = [f"{turn.at_ns / NS_PER_S:8.2f} s  {turn.words}" for turn in turns]
    text = "\n".join(lines) if lines else "the decision never changed"
    return Report(True, text, {"file": asked.file, "ok": True, "turns": rows})


def as_json(found: Explanation) -> dict[str, object]:
    """Return headline and lines as a row."""
    pairs = [line.split(maxsplit=1) for line in found.lines]
    return {"headline": found.headline, "lines": dict(pairs)}
