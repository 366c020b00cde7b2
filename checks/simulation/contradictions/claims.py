"""The rules: what each word claims, compared with what was.

A rule takes a word and returns what was so, if that contradicts it; empty if it was true. It asks
the truth of the run, never the product: names of persons, meanings of reasons and limits are tables
of its own. Rules at the end ask for words that are missing, and for ends without a cause.
"""

import re
from collections.abc import Callable, Iterable, Iterator
from itertools import dropwhile
from typing import Any, Final, NamedTuple

from checks.simulation.contradictions.programs import Ack
from checks.simulation.contradictions.truth import (
    Deed,
    EndedCommand,
    GoalTruth,
    Journal,
    RequestTruth,
    RobotRow,
    Said,
    ShownText,
    Truth,
    distance_m,
    person_of,
    place_of,
)
from checks.simulation.hosts.mavlink import GATEWAY
from checks.simulation.invariants.limits import InvariantViolation
from gateways.mavlink.mavlink_dialect import mavlink
from ground.client.missions import MissionEnded
from ground.client.outcomes import Accepted, DriveEnded, GoalEnded, Refused, Stopped
from ground.station.robot.lease_state import LeaseView
from protocol.outcome import RunOutcome
from protocol.wire.enums import Command, GoalState, Mode
from protocol.wire.enums import Vehicle as VehicleState
from protocol.wire.messages import CommandRequest, GoalRequest
from protocol.wire.reasons import Reason
from runtime.units import NS_PER_MS, NS_PER_S

Condition = Callable[[RobotRow], bool]

SEEN_NS: Final = 600 * NS_PER_MS
"""What a program says of now may be as old as this: messages on their way, and its own round."""

LEASE_NS: Final = 1_300 * NS_PER_MS
"""The same for the lease: its status is sent once a second."""

ARRIVED_M: Final = 0.35
"""A robot that says it is there is this near: the tolerance, and the error of its odometry."""

SAID_NS: Final = 3 * NS_PER_S
"""An end of a goal is said within this time by a program that hears the robot."""

CLEANED_NS: Final = 500 * NS_PER_MS
"""What a goal has left behind is ended within this time, before its end is said."""

CAUSED_NS: Final = 15 * NS_PER_S
"""A stop follows within this time from what a person has asked for."""


class Recorded(NamedTuple):
    """How the last goal has ended, by the summary of a recording."""

    outcome: str


def contradictions(
    truth: Truth, journal: Journal, errors: Iterable[tuple[str, BaseException]]
) -> tuple[InvariantViolation, ...]:
    """Return all contradictions of a run, in the order of their times."""
    found = [
        InvariantViolation("no program ends by itself", truth.now_ns, f"{name}: {error!r}")
        for name, error in errors
    ]
    observer = ClaimsObserver(truth, journal)
    known: set[tuple[str, str, Deed | None]] = set()
    for said in journal.words:
        for rule, why in observer.judge(said):
            if (key := (rule, said.program, said.deed)) not in known:  # a line repeats its claim
                known.add(key)
                words = f"{said.program} said {words_of(said)}: {why}"
                found.append(InvariantViolation(rule, said.ns, words))
    found += observer.judge_end()
    return tuple(sorted(found, key=lambda one: one.time_ns))


def words_of(said: Said) -> str:
    """Return a word with the deed to which it belongs."""
    text = text_of(said.value) or repr(said.value)
    return f"«{text.splitlines()[0]}»" + (f" of «{said.deed}»" if said.deed else "")


def text_of(value: Any) -> str:
    """Return the text that a person reads of a word; empty for one that is shown as it is."""
    match value:
        case EndedCommand():
            return f"{value.error or text_of(value.outcome)} (exit code {value.code})"
        case Exception():
            return f"{type(value).__name__}: {value}"
        case str():
            return value
    text = getattr(value, "text", "")
    return str(text() if callable(text) else text)


class ClaimsObserver:
    """Compares words with the truth."""

    def __init__(self, truth: Truth, journal: Journal) -> None:
        self.truth = truth
        self.journal = journal

    def judge(self, said: Said) -> Iterator[tuple[str, str]]:
        """Yield the rules that a word breaks, with what was so."""
        for kind, name, rule in RULES:
            if isinstance(said.value, kind) and (why := rule(self, said, said.value)):
                yield name, why

    # Outcomes of goals.

    def goal_of(self, deed: Deed, now_ns: int) -> GoalTruth | None:
        """Return the goal that the robot accepted for a deed: the newest at its place."""
        place = tuple(round(float(one), 3) for one in deed.arguments[:2])
        goals = self.truth.goals_of(deed.program, deed.began_ns, now_ns)
        return next((goal for goal in reversed(list(goals)) if goal.place == place), None)

    def outcome(self, said: Said, outcome: str, reason: str) -> str:
        """Judge the outcome of a goal."""
        deed = said.deed
        if deed is None or deed.verb not in GOAL_VERBS:
            return ""
        goal = self.goal_of(deed, said.ns)
        if outcome == "reached":
            return self._reached(goal)
        if outcome == "timeout":
            limit_s = float((*deed.arguments, 0.0, 0.0)[2]) or UP_S
            elapsed_s = (said.ns - deed.began_ns) / NS_PER_S
            return "" if elapsed_s >= limit_s else f"only {elapsed_s:.1f} s have passed"
        if goal is None:
            return ""
        end = goal.end
        is_known = end is not None and goal.by is None and self._knows(said, end.ns)
        if is_known and end is not None and end.goal_state == GoalState.REACHED:
            return "the robot had reached it"
        if outcome == "replaced":
            return self._replaced(goal, reason)
        if goal.by is not None and end is not None and end.ns <= said.ns:
            is_unheard = NO_ANSWER.search(reason) and self._could_not_hear(said, end.ns)
            words = f"it was replaced by «{asked_words(goal.by)}» of {goal.by.program}"
            return "" if is_unheard else words
        return self._cause(goal, outcome, reason)

    def _knows(self, said: Said, since_ns: int) -> bool:
        """Return whether its program had heard the robot since a time when it said this."""
        heard_ns = said.ns - LATE_NS - self.truth.silent_ns(said.program, said.ns - LATE_NS)
        return heard_ns > since_ns

    def _could_not_hear(self, said: Said, of_ns: int) -> bool:
        """Return whether its program had given a silent robot up, and what was so was in the gap.

        What has ended a goal in a gap cannot be told from what is seen after it.
        """
        since_ns, until_ns = self.truth.gap_at(said.program, of_ns, said.ns)
        return until_ns - since_ns >= SILENT_NS and said.ns - until_ns <= CLEANED_NS

    def _reached(self, goal: GoalTruth | None) -> str:
        if goal is None:
            return "the robot never accepted it"
        if goal.by is not None:
            return f"it was replaced by «{asked_words(goal.by)}» of {goal.by.program}"
        if goal.end is None or goal.end.goal_state != GoalState.REACHED:
            return "the robot had not reached it"
        off_m = distance_m(goal.end, goal.place)
        return "" if off_m <= ARRIVED_M else f"the robot stood {off_m:.2f} m from it"

    def _replaced(self, goal: GoalTruth, reason: str) -> str:
        if goal.by is None:
            return "no other goal had replaced it"
        by = self.truth.driven_after(goal.by)
        if not isinstance(by.request, GoalRequest):
            return ""
        x_m, y_m = place_of(by.request)
        if (found := REPLACED.search(reason)) is None:
            return ""
        said_m = float(found[1]), float(found[2])
        if max(abs(said_m[0] - x_m), abs(said_m[1] - y_m)) > ROUNDED_M:
            return f"it was replaced by the goal {x_m} {y_m}"
        name = found[3]
        if name and not self.is_doer(by, name):
            return f"that goal was of {by.program}"
        return ""

    def _cause(self, goal: GoalTruth, outcome: str, reason: str) -> str:
        """Compare the reason of an abort with that of the robot."""
        end = goal.end
        cause = next((cause for words, cause in CAUSES.items() if words in reason), None)
        named = ENDED_BY.match(reason)
        if named is not None and cause is None:
            cause = Reason.BY_OPERATOR
        if outcome != "aborted" or cause is None:
            return ""
        if end is None:
            return "the goal has not ended"
        if cause != end.goal_reason:
            return f"the robot's reason is {reason_name(end)}"
        return self._ended_by(goal, end, "" if named is None else named[1])

    def _ended_by(self, goal: GoalTruth, end: RobotRow, name: str) -> str:
        """Compare who ended a goal with the name that is said; empty: its own person."""
        rows, answered = self.truth.rows, self.truth.answered
        ender = next(
            (one for one in answered if rows[one.at].ns == end.ns and self.ends(one)), None
        )
        if ender is None or not ender.program or end.goal_reason not in BY_PERSONS:
            return ""
        is_other = person_of(ender.program) != person_of(goal.asked.program)
        if bool(name) != is_other:
            return f"{ender.program} has ended it, and the goal was of {goal.asked.program}"
        is_right = not name or self.is_doer(ender, name)
        return "" if is_right else f"{ender.program} has ended it"

    # Outcomes of drives by hand.

    def drive(self, said: Said, ended: DriveEnded) -> str:
        """Judge the end of a drive by hand; which one it is, is not said."""
        deed, truth = said.deed, self.truth
        if deed is None or deed.verb != "drive":
            return ""
        drives = truth.drives_of(deed.program, deed.began_ns, said.ns)
        found = [self._drive(said, ended.reason, one) for one in drives]
        return "" if "" in found or not found else found[0]

    def _drive(self, said: Said, reason: str, drive: RequestTruth) -> str:
        """Compare the end of a drive with what has driven since."""
        truth = self.truth
        later = truth.begun_after(drive, said.ns)
        if seized := SEIZED.match(reason):
            return self.held_by_another(said.program, seized[1], drive.ns, said.ns)
        if reason.startswith("replaced"):
            if not later:
                return "nothing else has driven since"
            is_right = any(self._is_named(one, reason) for one in later)
            return "" if is_right else f"it was replaced by {drive_words(later[0])}"
        if later and self._takes_over(drive, later[0]) and self._knows(said, later[0].ns):
            return f"it was replaced by {drive_words(later[0])}"
        if not reason and not truth.ever(drive.ns, said.ns, lambda row: row.mode == Mode.HOLD):
            return f"it does not hold: {state_words(truth.at(said.ns))}"
        return ""

    def _takes_over(self, drive: RequestTruth, by: RequestTruth) -> bool:
        """Return whether a drive went on until another one began."""
        rows = self.truth.rows[drive.at : by.at]
        went_on = dropwhile(lambda row: not row.is_armed, rows)  # armed after its begin
        return by.before.is_by_hand and all(row.is_by_hand for row in went_on)

    def _is_named(self, by: RequestTruth, reason: str) -> bool:
        """Return whether a drive is what the end of the one before names; it may name nothing."""
        if goal := REPLACED.search(reason):
            name = goal[3]
            if isinstance(by.request, GoalRequest):
                x_m, y_m = place_of(by.request)
                off_m = max(abs(float(goal[1]) - x_m), abs(float(goal[2]) - y_m))
                if off_m > ROUNDED_M:
                    return False
            elif by.begins_drive:
                return False
        elif by_hand := DRIVE_OF.search(reason):
            name = by_hand[1]
        else:
            return True
        return not name or self.is_doer(by, name)

    # Who has done something.

    def is_doer(self, one: RequestTruth, name: str) -> bool:
        """Return whether a request is of a program with this name, or of this MAVLink station."""
        if one.program != GATEWAY:
            return self.truth.is_name(one.program, name)
        deeds = [
            deed
            for deed in self.journal.deeds
            if deed.program in OWN_SYSTEM and 0 <= one.ns - deed.began_ns <= CAUSED_NS
        ]
        under_way = [deed for deed in deeds if one.ns - deed.until_ns(one.ns) <= CLEANED_NS]
        return name in {OWN_SYSTEM[deed.program] for deed in under_way or deeds}

    def done_by_another(
        self, said: Said, name: str, has_done: Callable[[RequestTruth], bool]
    ) -> str:
        """Judge who has done what is shown; what is shown may be that of a request before."""
        done = [one for one in self.truth.answered if one.ns <= said.ns and has_done(one)]
        recent = [one for one in done if said.ns - one.ns <= SAID_NS] or done[-1:]
        if any(not one.program or self.is_doer(one, name) for one in recent):
            return ""
        return f"{recent[-1].program} has done it" if recent else "nobody has done it"

    def holds(self, one: RequestTruth) -> bool:
        """Return whether a request holds the robot, which did not hold before."""
        is_held = self.truth.rows[one.at].mode == Mode.HOLD
        return one.ok and one.before.mode != Mode.HOLD and is_held

    def ends(self, one: RequestTruth) -> bool:
        """Return whether a request has ended a goal."""
        return one.ok and one.before.has_goal and not self.truth.rows[one.at].has_goal

    # Answers.

    def refused(self, said: Said, refusal: Refused) -> str:
        """Judge a refusal: its reason must have been so at some instant."""
        deed = said.deed
        if deed is None:
            return ""
        since_ns = deed.began_ns - SEEN_NS
        if refusal.reason == Reason.LEASE_HELD:
            return self.held_by_another(said.program, refusal.holder, since_ns, said.ns, deed.verb)
        condition = REFUSED.get(refusal.reason)
        if condition is None or self.truth.ever(since_ns, said.ns, condition):
            return ""
        return f"never so since it was asked: {state_words(self.truth.at(said.ns))}"

    def held_by_another(
        self, program: str, name: str, since_ns: int, until_ns: int, verb: str = ""
    ) -> str:
        """Judge that another operator commands, for which something was refused."""
        truth, person = self.truth, person_of(program)
        if verb in STOPPING:
            return "what stops needs no lease"
        rows = [
            row
            for row in truth.between(since_ns - LEASE_NS, until_ns)
            if truth.others_lease(row, person)
        ]
        if not rows:
            holder = truth.at(until_ns).holder
            whose = truth.person_of(holder) if holder else "nobody"
            return f"the lease was held by {whose}, the same person" if holder else "it was free"
        name = name.partition(" (")[0]
        if name and all(row.holder_name != name for row in rows):
            return f"it was held by {rows[-1].holder_name}"
        return ""

    def accepted(self, said: Said, accepted: Accepted) -> str:
        """Judge that a request was accepted: what it asks was so at some instant since."""
        deed = said.deed
        condition = None if deed is None else self.effect_of(deed, said.program)
        if deed is not None and (noted := NOTED.get(deed.verb)) is not None:
            since_ns, (note, had) = deed.began_ns, noted
            is_so = had if accepted.note != note else lambda row: not had(row)
            if not self.truth.ever(since_ns, said.ns, is_so):
                said_words = "there was nothing to do" if accepted.note == note else "it was done"
                return f"never so that {said_words}: {state_words(self.truth.at(said.ns))}"
        if deed is None or condition is None:
            return ""
        if self.truth.ever(deed.began_ns, said.ns, condition):
            return ""
        return f"never so since: {state_words(self.truth.at(said.ns))}"

    def effect_of(self, deed: Deed, program: str) -> Condition | None:
        """Return what is so after an accepted deed."""
        truth, person = self.truth, person_of(program)
        if deed.verb == "mode":
            mode = Mode[str(deed.arguments[0])]
            return lambda row: row.mode == mode
        if deed.verb in ("take", "seize"):
            return lambda row: truth.has_lease(row, person)
        if deed.verb == "release":
            return lambda row: not truth.has_lease(row, person)
        return EFFECTS.get(deed.verb)

    def acknowledged(self, said: Said, ack: Ack) -> str:
        """Judge an acknowledgement of MAVLink: what it accepts was so since the command."""
        if ack.result == mavlink.MAV_RESULT_ACCEPTED:
            condition = ACKNOWLEDGED.get((ack.number, ack.params[0] if ack.params else 0.0))
            if ack.number == mavlink.MAV_CMD_DO_SET_MODE:
                condition = self.has_mode(ack.params[1])
            if condition is None or self.truth.ever(ack.since_ns, said.ns, condition):
                return ""
            return f"never so since it was sent: {state_words(self.truth.at(said.ns))}"
        if ack.result == NOT_IN_CONTROL and ack.number in STOPS_OF_MAVLINK and not ack.params[0]:
            return "what stops needs no control"
        return ""

    def has_mode(self, mode: float) -> Condition:
        """Return whether a MAVLink station sees the robot in a mode.

        The gateway drives by speeds in MANUAL, which is GUIDED for its stations.
        """

        def is_so(row: RobotRow) -> bool:
            begun = self.truth.drive_at(row.ns)
            by_gateway = row.mode == Mode.MANUAL and begun is not None and begun.program == GATEWAY
            return row.mode == mode or (mode == Mode.GUIDED and by_gateway)

        return is_so

    def stopped(self, said: Said, stopped: Stopped) -> str:
        """Judge an acknowledged emergency stop."""
        if not stopped.ok or said.deed is None:
            return ""
        is_so = self.truth.ever(said.deed.began_ns, said.ns, lambda row: row.is_stopped)
        return "" if is_so else "no stop was latched"

    # Exit codes.

    def code(self, said: Said, ended: EndedCommand) -> str:
        """Judge an exit code: 0 of a goal only if the robot has reached it."""
        deed = said.deed
        if deed is None or deed.verb not in GOAL_VERBS:
            return ""
        goal = self.goal_of(deed, said.ns)
        is_there = goal is not None and not self._reached(goal)
        if ended.code == 0 and not is_there:
            return f"exit code 0: {self._reached(goal)}"
        silent_ns = self.truth.silent_ns(deed.program, said.ns)
        if NO_ANSWER.search(ended.error) and silent_ns < SEEN_NS:
            return f"a message of the robot arrived {silent_ns // NS_PER_MS} ms ago"
        if goal is not None and goal.by is not None and ended.error:
            return f"the goal was replaced by «{asked_words(goal.by)}» of {goal.by.program}"
        return ""

    # Texts.

    def text(self, said: Said, value: Any) -> str:
        """Judge each claim of a text."""
        if isinstance(value, Refused) or isinstance(getattr(value, "outcome", None), Refused):
            return ""  # the reason itself is judged
        text = text_of(value)
        for pattern, claim in CLAIMS:
            if (found := pattern.search(text)) and (why := claim(self, said, found)):
                return why
        return ""

    def lease(self, said: Said, lease: LeaseView) -> str:
        """Judge the lease that is shown."""
        person, truth = person_of(said.program), self.truth
        if not lease.known:
            return ""

        def is_so(row: RobotRow) -> bool:
            if not row.holder or not lease.held:
                return not row.holder and not lease.held
            is_own = truth.program_of(row.holder) == said.program
            is_ours = truth.person_of(row.holder) == person
            return (is_ours, is_own, row.holder_name) == (lease.ours, lease.own, lease.name)

        if truth.ever(said.ns - LEASE_NS, said.ns, is_so):
            return ""
        row = truth.at(said.ns)
        return f"the lease is held by {row.holder_name or 'nobody'} ({truth.person_of(row.holder)})"

    def mission(self, said: Said, mission: MissionEnded) -> str:
        """Judge the end of a mission."""
        deed = said.deed
        if deed is None or "fail" not in mission.text.lower():
            return ""
        return self.wanted_end(deed.began_ns, said.ns)

    def recorded(self, said: Said, recorded: Recorded) -> str:
        """Judge the summary of a recording, which ends with the robot's newest status."""
        row = self.truth.at(said.ns - LATE_NS)
        goal = self.truth.at(said.ns)
        expected = {ends_of(row), ends_of(goal)}
        return "" if recorded.outcome in set().union(*expected) else state_words(goal)

    def wanted_end(self, since_ns: int, until_ns: int) -> str:
        """Return which operator has ended the mission, which is no failure.

        A robot that is not armed any more has ended it before.
        """
        for one in self.truth.answered:
            before = one.before
            is_end = one.ok and before.is_armed and before.mission_state in UNDER_WAY
            if is_end and since_ns <= one.ns <= until_ns and ends_mission(one):
                return f"{one.program} has ended it: {asked_words(one)}"
        return ""

    # What is missing or has no cause.

    def judge_end(self) -> list[InvariantViolation]:
        """Return ends of goals that nobody said, and stops that nobody asked for."""
        return [*self._unsaid(), *self._uncaused()]

    def _unsaid(self) -> Iterator[InvariantViolation]:
        now_ns = self.truth.now_ns
        for deed in self.journal.deeds:
            if deed.verb not in GOAL_VERBS or deed.ended_ns is not None:
                continue
            goal = self.goal_of(deed, now_ns)
            is_app = deed.program.endswith("-app")
            if goal is None or goal.end is None or is_app or self._is_told(deed):
                continue
            if (
                now_ns - goal.end.ns > SAID_NS
                and self.truth.silent_ns(deed.program, now_ns) < SEEN_NS
            ):
                words = f"{deed.program} still waits for the end of «{deed}»"
                yield InvariantViolation("an end is said", goal.end.ns + SAID_NS, words)

    def _is_told(self, deed: Deed) -> bool:
        """Return whether the status line of `up` shows the end of its goal, while it goes on."""
        lines = (said.value for said in reversed(self.journal.words) if said.deed is deed)
        return any(isinstance(line, ShownText) and GOES_ON.search(line.text) for line in lines)

    def _uncaused(self) -> Iterator[InvariantViolation]:
        """Yield accepted stops of a goal or drive that no person has asked for.

        A program that ends early, or whose time is up, may stop what it has begun, nothing else.
        """
        for one in self.truth.answered:
            if one.ok and (what := self._stops(one)) and not self._is_caused(one):
                words = (
                    f"{one.program} has sent «{asked_words(one)}», which ended {what}; "
                    "nobody has asked for that"
                )
                yield InvariantViolation("what stops has a cause", one.ns, words)

    def _stops(self, one: RequestTruth) -> str:
        """Return what a request has ended; empty if nothing."""
        before, after = one.before, self.truth.rows[one.at]
        if not isinstance(one.request, CommandRequest):
            return ""
        if before.has_goal and not after.has_goal and after.goal_id == before.goal_id:
            return f"the goal {self._goal_words(before.goal_id)}"
        if before.mission_state in UNDER_WAY and after.mission_state not in UNDER_WAY:
            return "the mission"
        if before.mode != Mode.HOLD and after.mode == Mode.HOLD:
            if before.drives:
                return f"the drive to {self._goal_words(before.goal_id)}"
            if before.mode == Mode.MANUAL and before.is_armed:
                return "the drive by hand"
        return ""

    def _goal_words(self, goal_id: int) -> str:
        asked = next((one for one in self.truth.answered if one.number == goal_id), None)
        return "?" if asked is None else f"«{asked_words(asked)}» of {asked.program}"

    def _is_caused(self, one: RequestTruth) -> bool:
        """Return whether a person has asked for a stop, or for the end of what it has ended."""
        if one.is_command(Command.DO_FLIGHTTERMINATION):  # it names no operator
            pressed = (deed for deed in self.journal.deeds if deed.verb in ("estop", "stop"))
            return any(0 <= one.ns - deed.began_ns <= CAUSED_NS for deed in pressed)
        by_gateway = one.program == GATEWAY
        for deed in self.journal.deeds:
            is_own = (
                deed.program.startswith("client") if by_gateway else deed.program == one.program
            )
            if not is_own or not deed.began_ns <= one.ns <= deed.began_ns + CAUSED_NS:
                continue
            if deed.verb in (BY_HAND if one.begins_drive else ASKS_TO_STOP):
                return True
            if by_gateway and deed.verb in CHOOSES_MODE:
                return True
        return not by_gateway and self._ends_its_own(one)

    def _ends_its_own(self, one: RequestTruth) -> bool:
        """Return whether a request ends what a deed of the same program has begun, at its end."""
        before = one.before
        for deed in self.journal.deeds:
            if deed.program != one.program or not self._is_over(deed, one.ns):
                continue
            if before.has_goal:
                goal = self.goal_of(deed, one.ns) if deed.verb in GOAL_VERBS else None
                if goal is not None and goal.asked.number == before.goal_id:
                    return True
            begun = None
            if before.mission_state in UNDER_WAY and deed.verb == "mission":
                begun = self.truth.mission_before(one)
            elif before.mode == Mode.MANUAL and deed.verb == "drive":
                begun = self.truth.drive_before(one)
            if begun is not None and begun.program == deed.program:
                return True
        return False

    def _is_over(self, deed: Deed, now_ns: int) -> bool:
        """Return whether a deed has been ended, by its person, its time limit or a silent robot."""
        if now_ns < deed.began_ns:
            return False
        if deed.cancelled_ns is not None and deed.cancelled_ns <= now_ns:
            return True
        limit_s = float((*deed.arguments, 0.0, 0.0, 0.0)[2]) if deed.verb in LIMITED else 0.0
        if limit_s and now_ns >= deed.began_ns + limit_s * NS_PER_S:
            return True
        return self.truth.gap_ns(deed.program, now_ns - CAUSED_NS, now_ns) >= SILENT_NS


def ends_of(row: RobotRow) -> tuple[str, ...]:
    """Return the words for the end of the robot's goal, or for the time before it."""
    if row.has_goal:
        return ("held",) if row.mode == Mode.HOLD else ("driving",)
    return SUMMARIES[row.goal_state]


def ends_mission(one: RequestTruth) -> bool:
    """Return whether an accepted request ends a mission: by another drive, or by a stop."""
    is_stop = any(one.is_command(*words) for words in ENDS_MISSION)
    return is_stop or one.begins_drive or isinstance(one.request, GoalRequest)


def asked_words(one: RequestTruth) -> str:
    """Return a request in words."""
    if isinstance(one.request, GoalRequest):
        x_m, y_m = place_of(one.request)
        return f"goto {x_m:g} {y_m:g}"
    if isinstance(one.request, CommandRequest):
        return f"{Command(one.request.command).name} {one.request.param1:g} {one.request.param2:g}"
    return type(one.request).__name__


def drive_words(one: RequestTruth) -> str:
    """Return what has begun a drive, and by which program."""
    return f"«{asked_words(one)}» of {one.program}"


def state_words(row: RobotRow) -> str:
    """Return the robot's state in words."""
    goal = GoalState(row.goal_state).name
    return f"{VehicleState(row.vehicle).name} {Mode(row.mode).name}, goal {goal}"


def reason_name(row: RobotRow) -> str:
    """Return the reason of the end of a goal."""
    return Reason(row.goal_reason).name


GOAL_VERBS: Final = ("goto", "limited", "up")
LIMITED: Final = ("goto", "limited", "drive")
"""Verbs whose third argument is a time limit in seconds, 0 for none."""

SILENT_NS: Final = 1_900 * NS_PER_MS
"""A program gives up after 3 s without a status that is sent once a second."""

UP_S: Final = 100.0
ROUNDED_M: Final = 0.051
STOPPING: Final = ("hold", "abort", "disarm", "estop")
ASKS_TO_STOP: Final = (*STOPPING, "mode", "pause", "stop")
BY_HAND: Final = ("drive", "mode", "steer")
CHOOSES_MODE: Final = ("steer", "target", "drive")
"""Deeds of a MAVLink station that begin with a mode, which ends another goal."""

UNDER_WAY: Final = (2, 3, 4)
SUMMARIES: Final[dict[int, tuple[str, ...]]] = {
    GoalState.NONE: ("no goal",),
    GoalState.REACHED: ("reached",),
    GoalState.STUCK: ("stuck", "lost", "unreachable"),
    GoalState.ABORTED: ("aborted",),
    GoalState.REFUSED: ("aborted",),
}
LATE_NS: Final = 100 * NS_PER_MS
"""The newest status that was sent may be of a tick before."""

ENDS_MISSION: Final[tuple[tuple[Any, ...], ...]] = (
    (Command.SIDESTEP_ABORT_GOAL,),
    (Command.DO_FLIGHTTERMINATION,),
    (Command.NAV_RETURN_TO_LAUNCH,),
    (Command.COMPONENT_ARM_DISARM, 0.0),
)
REPLACED: Final = re.compile(r"by the goal (-?[\d.]+) (-?[\d.]+)(?: of (.+))?")
DRIVE_OF: Final = re.compile(r"by the drive of (.+)")
SEIZED: Final = re.compile(r"(.+) has seized the lease")
ENDED_BY: Final = re.compile(r"(?:disarmed |driven by hand )?by (?!the )(.+)")
"""A reason that names another person."""

BY_PERSONS: Final = (Reason.BY_OPERATOR, Reason.DISARMED, Reason.BY_HAND)
NOTED: Final[dict[str, tuple[int, Condition]]] = {
    "clear": (Reason.NOTHING_LATCHED, lambda row: row.is_stopped),
    "hold": (
        Reason.NOTHING_KEPT,
        lambda row: row.has_goal or row.mission_state in UNDER_WAY,
    ),
    "release": (Reason.NO_LEASE, lambda row: bool(row.holder)),
    "arm": (Reason.NOTHING_CHANGED, lambda row: not row.is_armed),
    "disarm": (
        Reason.NOTHING_CHANGED,
        lambda row: row.vehicle in (VehicleState.ACTIVE, VehicleState.FAILSAFE),
    ),
}
"""What a person may ask for in vain: the note that says so, and what was so if it was not."""

GOES_ON: Final = re.compile(r"goal \w+, (?:an operator commands|ends in \d+ s)")
TOLD: Final = re.compile(r"goal (\w+), an operator commands")
NO_ANSWER: Final = re.compile(r"does not answer|no message from the robot|no heartbeat")
NOT_IN_CONTROL: Final = 10
CAUSES: Final = {
    "disarmed": Reason.DISARMED,
    "driven by hand": Reason.BY_HAND,
    "by the operator": Reason.BY_OPERATOR,
    "by the emergency stop": Reason.BY_EMERGENCY_STOP,
    "no operator heartbeat": Reason.OPERATOR_LOST,
}
REFUSED: Final[dict[int, Condition]] = {
    Reason.NOT_ARMED: lambda row: not row.is_armed,
    Reason.EMERGENCY_STOPPED: lambda row: row.is_stopped,
    Reason.NO_GOAL: lambda row: not row.has_goal,
    Reason.NOTHING_TO_ABORT: lambda row: not row.has_goal,
}
EFFECTS: Final[dict[str, Condition]] = {
    "arm": lambda row: row.is_armed,
    "disarm": lambda row: not row.is_armed,
    "hold": lambda row: row.mode == Mode.HOLD,
    "abort": lambda row: not row.has_goal,
    "clear": lambda row: not row.is_stopped,
}
ACKNOWLEDGED: Final[dict[tuple[int, float], Condition]] = {
    (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0): lambda row: row.is_armed,
    (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0): lambda row: not row.is_armed,
    (mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0.0): lambda row: row.mode == Mode.HOLD,
    (mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1.0): lambda row: row.is_stopped,
    (mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 0.0): lambda row: not row.is_stopped,
}
STOPS_OF_MAVLINK: Final = (
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
    mavlink.MAV_CMD_DO_PAUSE_CONTINUE,
)


def silent(observer: ClaimsObserver, said: Said, found: re.Match[str]) -> str:
    """Judge that nothing of the robot has arrived for some time.

    The end of a goal is said after its clean-up, during which the robot may be heard again.
    """
    truth, ns, claimed_ns = observer.truth, said.ns, round(float(found[1]) * NS_PER_S)
    silent_ns = truth.silent_ns(said.program, ns)
    if isinstance(said.value, GoalEnded | EndedCommand):
        silent_ns = truth.gap_ns(said.program, ns - CLEANED_NS, ns)
    if silent_ns >= claimed_ns - SEEN_NS / 2:
        return ""
    return f"a message of the robot arrived {truth.silent_ns(said.program, ns) // NS_PER_MS} ms ago"


def not_shown(observer: ClaimsObserver, said: Said, _found: re.Match[str]) -> str:
    """Judge that no status has shown the goal."""
    deed = said.deed
    goal = None if deed is None else observer.goal_of(deed, said.ns)
    shown_ns = None if goal is None else observer.truth.shown_ns.get(goal.asked.number)
    if shown_ns is None or said.ns - shown_ns < SEEN_NS:
        return ""
    return f"it was shown {(said.ns - shown_ns) // NS_PER_MS} ms before"


def commands(observer: ClaimsObserver, said: Said, found: re.Match[str]) -> str:
    """Judge that another operator commands the robot."""
    name = (found[1] or "").strip()
    if (own := OWN_SYSTEM.get(said.program)) and name == own:
        return f"{name} is this station itself"
    deed = said.deed
    since_ns = said.ns - SEEN_NS if deed is None else deed.began_ns
    verb = "" if deed is None else deed.verb
    if said.program.startswith("client"):
        return ""
    return observer.held_by_another(said.program, name, since_ns - SEEN_NS, said.ns, verb)


def in_command(observer: ClaimsObserver, said: Said, found: re.Match[str]) -> str:
    """Judge that somebody is in command now."""
    name = found[1]
    person = observer.truth.person_of
    is_so: Condition = lambda row: name == (row.holder_name or person(row.holder))  # noqa: E731
    if observer.truth.ever(said.ns - LEASE_NS, said.ns, is_so):
        return ""
    return f"it was {observer.truth.at(said.ns).holder_name or 'nobody'}"


def you_command(observer: ClaimsObserver, said: Said, _found: re.Match[str]) -> str:
    """Judge that this program's person is in command."""
    truth, person = observer.truth, person_of(said.program)
    if truth.ever(said.ns - LEASE_NS, said.ns, lambda row: truth.has_lease(row, person)):
        return ""
    return f"it was {truth.at(said.ns).holder_name or 'nobody'}"


def operator_limit(observer: ClaimsObserver, said: Said, found: re.Match[str]) -> str:
    """Judge the time after which the robot stops without its operator."""
    limit_s = observer.truth.at(said.ns).op_lost_ms / 1000
    return "" if float(found[1]) == limit_s else f"op_lost_ms of the robot is {limit_s:g} s"


def held_by(observer: ClaimsObserver, said: Said, found: re.Match[str]) -> str:
    """Judge who holds the robot."""
    return observer.done_by_another(said, found[1], observer.holds)


def ended_by(observer: ClaimsObserver, said: Said, found: re.Match[str]) -> str:
    """Judge who has ended a goal."""
    return observer.done_by_another(said, found[1], observer.ends)


def failed_mission(observer: ClaimsObserver, said: Said, _found: re.Match[str]) -> str:
    """Judge that a mission has failed."""
    return observer.wanted_end(said.ns - SEEN_NS, said.ns)


def who_stopped(observer: ClaimsObserver, said: Said, found: re.Match[str]) -> str:
    """Judge who has pressed the emergency stop that is shown."""
    rows = observer.truth.between(said.ns - SEEN_NS, said.ns)
    if not any(row.is_stopped for row in rows):
        return "no stop is latched"
    pressed = observer.truth.pressed
    own = {pressed.get(row.stop_id) == said.program for row in rows if row.is_stopped}
    return (
        ""
        if (found[1] == "you") in own
        else "somebody else has"
        if found[1] == "you"
        else "you have"
    )


def standing(observer: ClaimsObserver, said: Said, _found: re.Match[str]) -> str:
    """Judge that the wheels stand."""
    slowest = min(abs(row.speed_m_s) for row in observer.truth.between(said.ns - SEEN_NS, said.ns))
    return "" if slowest < 0.03 else f"the robot moves at {slowest:.2f} m/s"


def told(observer: ClaimsObserver, said: Said, found: re.Match[str]) -> str:
    """Judge that the goal of `up` has ended, and that an operator drives."""
    deed, truth = said.deed, observer.truth
    goal = None if deed is None else observer.goal_of(deed, said.ns)
    if goal is None and deed is not None and truth.refused_goal(deed.program, deed.began_ns):
        return "" if found[1] == "aborted" else "its goal was refused"
    if goal is None or goal.end is None:
        return "its goal has not ended"
    if (found[1] == "replaced") != (goal.by is not None):
        return f"it was {'replaced' if goal.by else 'not replaced'}"
    since_ns = said.ns - LEASE_NS
    if truth.ever(since_ns, said.ns, lambda row: bool(row.holder) or row.drives or row.is_by_hand):
        return ""
    return "nobody commands the robot"


OWN_SYSTEM: Final = {"client-255": "MAVLink 255", "client-254": "MAVLink 254"}
NAME: Final = r"(?!the )(MAVLink \d+|[\w@:.-]+)"
"""The name of a program or a person; no other words."""

Claim = Callable[[ClaimsObserver, Said, "re.Match[str]"], str]
CLAIMS: Final[tuple[tuple[re.Pattern[str], Claim], ...]] = (
    (re.compile(r"no message from the robot for ([\d.]+) s"), silent),
    (re.compile(r"waiting for the robot to show this goal"), not_shown),
    (TOLD, told),
    (re.compile(r"another operator commands the robot(?:: ([^()]+))?"), commands),
    (re.compile(r"(MAVLink \d+|\S+)(?: \(.+\))? is in command"), in_command),
    (re.compile(r"you are in command|you command r1"), you_command),
    (re.compile(r"stops ([\d.]+) s after the last heartbeat"), operator_limit),
    (re.compile(r"no operator heartbeat for ([\d.]+) s"), operator_limit),
    (re.compile(r"mission FAILED"), failed_mission),
    (re.compile(rf"(?:\bheld|mode HOLD) by {NAME}"), held_by),
    (re.compile(rf"goal ABORTED(?:: disarmed)? by {NAME}"), ended_by),
    (re.compile(r"EMERGENCY STOP r1\s+by (you|another operator)"), who_stopped),
    (re.compile(r"wheels stand"), standing),
)
"""What a text claims, and how each is judged."""

RULES: Final[tuple[tuple[type[Any], str, Callable[[ClaimsObserver, Said, Any], str]], ...]] = (
    (
        GoalEnded,
        "an outcome is of the goal that was asked for",
        lambda observer, said, end: observer.outcome(said, end.outcome, end.reason),
    ),
    (
        EndedCommand,
        "an outcome is of the goal that was asked for",
        lambda observer, said, end: (
            observer.outcome(said, end.outcome.outcome, end.outcome.reason)
            if isinstance(end.outcome, RunOutcome)
            else ""
        ),
    ),
    (DriveEnded, "a drive by hand ends as it ended", ClaimsObserver.drive),
    (EndedCommand, "an exit code is of the goal that was asked for", ClaimsObserver.code),
    (Refused, "a refusal has a reason", ClaimsObserver.refused),
    (Accepted, "what is accepted is so", ClaimsObserver.accepted),
    (Ack, "what is acknowledged is so", ClaimsObserver.acknowledged),
    (Stopped, "what is accepted is so", ClaimsObserver.stopped),
    (LeaseView, "a lease is shown as it is", ClaimsObserver.lease),
    (Recorded, "a recording ends as it ended", ClaimsObserver.recorded),
    (MissionEnded, "a mission ends as it ended", ClaimsObserver.mission),
    (object, "a text is true", ClaimsObserver.text),
)
"""By the type of a word: the rule."""
