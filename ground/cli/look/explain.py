"""`explain`: why did it turn? Of a robot that is there, or at an instant of a recording."""

import argparse
from pathlib import Path
from typing import Final

from ground.client.connection import LONGEST_S, add_common, common_of
from ground.client.link import LISTEN_NS, Link, linked
from ground.client.telemetry import Telemetry
from ground.explain.explanation import Explanation, explain
from ground.explain.from_recording import Recorded, Turn
from ground.recording.log_index import LogIndex
from ground.recording.log_reader import opened
from ground.text.output import Says
from protocol.options import up_to
from protocol.topics import CYCLE, DECISION, STATUS
from runtime.errors import UserError
from runtime.units import NS_PER_S

NEXT_NS: Final = 200_000_000
moment: Final = up_to(LONGEST_S)


def arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", nargs="?", metavar="FILE", help="a recording; else the robot, now")
    parser.add_argument(
        "--at", type=moment, metavar="S", help="seconds of the recording (the last turning point)"
    )
    parser.add_argument("--turns", action="store_true", help="list its turning points")
    add_common(parser)


def run(options: argparse.Namespace, says: Says) -> int:
    if options.file is not None:
        return of_a_recording(options, says)
    refuse_without_a_recording(options)
    with linked(common_of(options)) as link:
        return act(options, link, says)


def act(options: argparse.Namespace, link: Link, says: Says) -> int:
    """0 when a decision was heard, 1 when none was."""
    if options.file is not None:
        return of_a_recording(options, says)
    refuse_without_a_recording(options)
    with link.hearing(STATUS, DECISION, CYCLE) as telemetry:
        return of_a_robot(link, says, telemetry)


def of_a_robot(link: Link, says: Says, telemetry: Telemetry) -> int:
    """The next decision that is heard."""
    link.wait(lambda: telemetry.latest(DECISION) is not None, LISTEN_NS)
    before = telemetry.latest(DECISION)
    if before is None:
        why = link.diagnosis()
        says.result({"robot": link.robot, "ok": False, "reason": why}, why)
        return 1
    link.wait(lambda: telemetry.latest(DECISION) != before, NEXT_NS)
    link.wait(lambda: telemetry.latest(STATUS) is not None, NEXT_NS)
    now_ns = link.clock.now_ns()
    decision, status = telemetry.live(DECISION, now_ns), telemetry.live(STATUS, now_ns)
    found = explain(decision, status, telemetry.live(CYCLE, now_ns), before[0])
    says.result({"robot": link.robot, "ok": True, **as_json(found)}, found.text())
    return 0


def refuse_without_a_recording(options: argparse.Namespace) -> None:
    if options.at is not None or options.turns:
        raise UserError("--at and --turns look into a recording: name its FILE")


def of_a_recording(options: argparse.Namespace, says: Says) -> int:
    """0 when something could be told, 1 when the recording has nothing or is damaged."""
    reel = LogIndex(opened(Path(options.file), options.id))
    if reel.damage:
        says.note(f"{options.file}: DAMAGED: {reel.damage}")
    recorded = Recorded(reel)
    turns = list(recorded.turns())
    if options.turns:
        return tell_turns(options, says, turns)
    at_ns = chosen_ns(options, reel, turns)
    told = recorded.at(at_ns)
    if told is None:
        raise UserError(f"{options.file}: no decision is recorded up to {at_ns / NS_PER_S:g} s")
    decided_ns, found = told
    at_s = decided_ns / NS_PER_S
    json = {"file": options.file, "ok": True, "at_s": at_s, **as_json(found)}
    says.result(json, f"at {at_s:.2f} s it {found.text()}")
    return 1 if reel.damage else 0


def chosen_ns(options: argparse.Namespace, reel: LogIndex, turns: list[Turn]) -> int:
    """The instant asked for, else the last turning point, else the end."""
    asked_s: float | None = options.at
    if asked_s is not None:
        return instant_ns(options.file, reel, asked_s)
    return turns[-1].at_ns if turns else reel.duration_ns


def instant_ns(file: str, reel: LogIndex, at_s: float) -> int:
    """On the timeline of the recording; UserError when that ends before."""
    at_ns = round(at_s * NS_PER_S)
    if at_ns > reel.duration_ns:
        raise UserError(f"{file} ends at {reel.duration_ns / NS_PER_S:.2f} s, before {at_s:g} s")
    return at_ns


def tell_turns(options: argparse.Namespace, says: Says, turns: list[Turn]) -> int:
    rows = [{"at_s": turn.at_ns / NS_PER_S, "changed": turn.words} for turn in turns]
    lines = [f"{turn.at_ns / NS_PER_S:8.2f} s  {turn.words}" for turn in turns]
    text = "\n".join(lines) if lines else "it decided the same all the time"
    says.result({"file": options.file, "ok": True, "turns": rows}, text)
    return 0


def as_json(found: Explanation) -> dict[str, object]:
    pairs = [line.split(maxsplit=1) for line in found.lines]
    return {"headline": found.headline, "lines": dict(pairs)}
