"""Make the side panel of the Drive screen: what the robot does, where it is, what it senses.

It has a sentence that changes slowly enough to be read, the way to the goal, the mission and its
draft, the sonars, the board that runs the control core, and the health of all parts in one row.
"""

from math import cos, degrees, hypot, inf, isfinite, sin
from textwrap import wrap
from typing import Final, NamedTuple

from ground.app.panels.aged import MISSING, aged, live, number, role_of
from ground.app.widgets.bars import HEIGHTS, bar, spark_rows
from ground.app.widgets.rows import Row, Span, cut, faint, head, row, width_of
from ground.client.status_line import PLACE_UNKNOWN, doing, knows_place
from ground.client.telemetry import Age, AgedMessage
from ground.explain import headline
from ground.map.scene import MapTarget
from ground.station.history.telemetry_history import uncertainty_m
from ground.station.station import Station
from ground.text.wording import SONAR_NAMES, state_role
from protocol.outcome import LOST, doubt_of, doubt_words, goal_end, mission_state, reason_words
from protocol.ring import SONARS
from protocol.topics import CYCLE, DECISION, HEARTBEAT, MCU, MISSION, ODOMETRY, SONAR, STATUS, TRUTH
from protocol.wire.enums import GoalState, MissionState
from protocol.wire.messages import (
    AvoidanceDecision,
    CycleReport,
    GroundTruth,
    McuStatus,
    MissionStatus,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
)
from runtime.units import MM_PER_M, NS_PER_S

MOST: Final = 6


def mission_rows(station: Station) -> list[Row]:
    """Return the state and the items around the current one; no rows without a mission."""
    seen = station.seen(MISSION)
    status = seen.message
    if not isinstance(status, MissionStatus) or status.state == MissionState.NONE:
        return []
    items = list(enumerate(station.mission_items))
    first = max(0, min(status.current - 1, len(items) - MOST))
    return [
        row(head("mission "), aged(seen, mission_words, "mission")),
        *(item_row(number, item, status.current) for number, item in items[first : first + MOST]),
    ]


def draft_rows(count: int) -> list[Row]:
    """Return how many waypoints wait to be sent; no rows when there are none."""
    waypoints = f"{count} waypoint{'' if count == 1 else 's'}"
    return [row(head("draft   "), Span(f"{waypoints}, W sends", "draft"))] if count else []


def item_row(number: int, item: MapTarget, current: int) -> Row:
    """Return the row of an item, counted from 1.

    Completed items are faint, the current one is marked.
    """
    heading = item.heading_rad
    deg = "any" if heading is None else f"{degrees(heading):z.0f}°"
    words = f"{number + 1:>3}  {item.x_m:z6.2f} {item.y_m:z6.2f}  {deg:>5}"
    role = "faint" if number < current else "mission" if number == current else "text"
    return row(Span("▶" if number == current else " ", "mission"), Span(words, role))


def mission_words(status: MissionStatus) -> str:
    """Return state, current item, hold time and reason as text."""
    state = mission_state(status.state, status.reason)
    hold = f", holds {status.hold_left_ms / 1000:.0f} s" if status.hold_left_ms else ""
    why = f": {reason_words(status.reason, status.stopped_by)}" if status.reason else ""
    return f"{state} {status.current + 1}/{status.count}{hold}{why}"


RENEWED_NS: Final = NS_PER_S // 2
GAP: Final = "  "
LEAST: Final = 8


class Sentence:
    """Keeps the sentence for half a second, unless the robot's state or branch changes."""

    def __init__(self) -> None:
        self._key: tuple[object, ...] = ()
        self._text = ""

    def rows(self, station: Station, width: int, most: int) -> list[Row]:
        """Return the state, then the sentence wrapped to exactly `most` rows."""
        seen = station.seen(STATUS)
        status: NavigatorStatus | None = live(seen)
        if status is None:
            first = row(head("state "), aged(seen, lambda _: MISSING))
            return [first, *(() for _ in range(most - 1))]
        state = doing(status).upper()
        decision: AvoidanceDecision | None = live(station.seen(DECISION))
        text = self._renewed(station, decision, status)
        lines = wrap(
            f"{state}{GAP}{text}", max(LEAST, width), max_lines=max(1, most), placeholder="…"
        )
        begin, rest = lines[0][: len(state)], lines[0][len(state) :]
        role = role_of(seen)
        first = row(Span(begin, state_role(status)), Span(rest, role))
        rows = [first, *(row(Span(line, role)) for line in lines[1:])]
        return [*rows, *(() for _ in range(most - len(rows)))]

    def _renewed(
        self, station: Station, decision: AvoidanceDecision | None, status: NavigatorStatus
    ) -> str:
        branch = None if decision is None else decision.branch
        state = (status.vehicle, status.mode, status.goal, status.vehicle_reason)
        key = (station.robot, state, branch, station.now_ns // RENEWED_NS)
        if key != self._key:
            self._key, self._text = key, headline(decision, status)
        return self._text


LEAST_CELL: Final = 4
MOST_CELL: Final = 8
LABEL: Final = 6
BESIDE: Final = "│"
DEAD: Final = "dead"
NO_ECHO: Final = "none"
LEFT_TO_RIGHT: Final = tuple(reversed(range(SONARS)))


class Limits:
    """The distances in metres that a range is compared with, as the robot itself has them."""

    def __init__(self, station: Station) -> None:
        decision: AvoidanceDecision | None = live(station.seen(DECISION))
        self.zone_m = decision.zone_m if decision is not None else -inf
        stop_m = station.limit("guard_stop_m")
        self.stop_m = -inf if stop_m is None else stop_m
        self.longest_m = station.limit("sonar_max_m")
        """The farthest range; None while it is unknown: then there are no bars."""

    def role(self, range_m: float) -> str:
        """Return the role of a range."""
        if range_m < self.stop_m:
            return "danger"
        return "caution" if range_m < self.zone_m else "ok"

    def marks(self, range_m: float) -> str:
        """Return `!` for an echo in the zone, `!!` where the guard stops."""
        return {"danger": "!!", "caution": "!"}.get(self.role(range_m), "")


def sonar_rows(station: Station, width: int, bars: int) -> list[Row]:
    """Return the names, `bars` rows of bars, and the ranges.

    A sonar that gave no reading in one of the last scans is `dead`, in a colour that does not mean
    health.
    """
    seen, limits = station.seen(SONAR), Limits(station)
    scan: SonarScan | None = live(seen)
    labelled = width >= LABEL + 1 + (LEAST_CELL + 1) * SONARS
    label = LABEL if labelled else 0
    cell = max(LEAST_CELL, min(MOST_CELL, (width - label - 1) // SONARS))
    silent = station.silent_sonars
    ranges = [None if scan is None else range_of(scan, sonar, silent) for sonar in LEFT_TO_RIGHT]
    titles = ["sonar", *("" for _ in range(bars)), "m"]
    if bars > 1:
        titles[1] = f"{number(limits.longest_m, 'g')} m"
    rows = [
        [head(f"{SONAR_NAMES[sonar]:^{cell}}") for sonar in LEFT_TO_RIGHT],
        *(
            [bar_span(one, level, bars, cell, limits, seen) for one in ranges]
            for level in reversed(range(bars))
        ),
        [value_span(one, cell, limits, seen, marked=not bars) for one in ranges],
    ]
    return [
        row(*((head(f"{title:<{label}}"),) if label else ()), *spans[:4], faint(BESIDE), *spans[4:])
        for title, spans in zip(titles, rows, strict=True)
    ]


def bar_span(
    range_m: float | None, level: int, bars: int, cell: int, limits: Limits, seen: AgedMessage
) -> Span:
    """Return the part of a bar in one row; the lowest row, level 0, has the marks."""
    if range_m is None:
        return faint(f"{'·' if level == 0 else '':^{cell}}")
    if range_m == inf or limits.longest_m is None:
        return faint(f"{'·':^{cell}}")
    eighths = max(1, round(min(1.0, range_m / limits.longest_m) * bars * len(HEIGHTS)))
    here = min(len(HEIGHTS), eighths - level * len(HEIGHTS))
    glyph = HEIGHTS[here - 1] if here > 0 else " "
    marks = limits.marks(range_m) if level == 0 else ""
    indent = (cell - 1) // 2
    text = f"{' ' * indent}{glyph}{marks}".ljust(cell)[:cell]
    return Span(text, role_of(seen, limits.role(range_m)))


def value_span(
    range_m: float | None, cell: int, limits: Limits, seen: AgedMessage, *, marked: bool
) -> Span:
    """Return a range in metres; `>3` without an echo within 3 m, `dead` without a reading."""
    if live(seen) is None:
        return faint(f"{MISSING:^{cell}}")
    if range_m is None:
        return Span(f"{DEAD:^{cell}}", "dead")
    if range_m == inf:
        none = NO_ECHO if limits.longest_m is None else f">{limits.longest_m:g}"
        return faint(f"{none:^{cell}}")
    text = f"{range_m:.2f}"
    if cell == LEAST_CELL:
        text = text[1:] if range_m < 1.0 and text[0] == "0" else f"{range_m:.1f}"
    role = limits.role(range_m)
    marks = limits.marks(range_m) if marked else ""
    text = f"{text}{marks}" if len(text + marks) <= cell else f"{text}{marks[:1]}"
    return Span(f"{text:^{cell}}", role_of(seen, role if role != "ok" else "text"))


def range_of(scan: SonarScan, sonar: int, silent: int) -> float | None:
    """Return a range in metres: inf without an echo, None when the sonar gives no reading."""
    bit = 1 << sonar
    if silent & bit or not scan.valid & bit:
        return None
    return scan.range_mm[sonar] / 1000 if scan.echo & bit else inf


def dead_sonars(station: Station) -> list[str]:
    """Return the names of the sonars without a reading, from left to right."""
    if live(station.seen(SONAR)) is None:
        return []
    return [SONAR_NAMES[sonar] for sonar in LEFT_TO_RIGHT if station.silent_sonars >> sonar & 1]


US_PER_MS: Final = 1000.0
BYTES_PER_KB: Final = 1000.0


def board_rows(station: Station) -> list[Row]:
    """Return one row for the side panel; none if no board was ever seen."""
    seen = station.seen(MCU)
    if not isinstance(seen.message, McuStatus):
        return []
    return [row(head(f"{name_of(seen.message)} "), aged(seen, short_words))]


def board_details(station: Station) -> list[Row]:
    """Return the rows of the Links screen; none if no board was ever seen."""
    seen = station.seen(MCU)
    if not isinstance(seen.message, McuStatus):
        return []
    status: McuStatus | None = live(seen)
    first = row(head(f" {name_of(seen.message)}  "), aged(seen, time_words))
    if status is None:
        return [first]
    memory = Span(f"         {memory_words(status)}, ", role_of(seen))
    noise = "caution" if status.skipped_bytes else "text"
    return [first, row(memory, Span(f"{status.skipped_bytes} bytes skipped", role_of(seen, noise)))]


def name_of(status: McuStatus) -> str:
    """Return the kind of the board."""
    return "MCU (emulated)" if status.emulated else "MCU"


def short_words(status: McuStatus) -> str:
    """Return the modelled time until the wheel command, and the RAM in use."""
    return f"{ms(status.command_us)} ms  {kilobytes(status.ram_bytes)} kB"


def time_words(status: McuStatus) -> str:
    """Return the modelled times, compared with the control period."""
    command, busy = ms(status.command_us), ms(status.busy_us)
    return f"command after {command} ms, done after {busy} of {ms(status.budget_us)} ms (modelled)"


def memory_words(status: McuStatus) -> str:
    """Return the RAM in use at most, of that which the image has."""
    return f"RAM {kilobytes(status.ram_bytes)} of {kilobytes(status.ram_size_bytes)} kB"


def ms(time_us: int) -> str:
    """Return a time in milliseconds."""
    return f"{time_us / US_PER_MS:.1f}"


def kilobytes(count: int) -> str:
    """Return a number of bytes in kilobytes."""
    return f"{count / BYTES_PER_KB:.1f}"


LEAST_BAR: Final = 8
FULL: Final = 40
"""From so many columns on, the time since the goal was set is named."""
UNDER_WAY: Final = (MissionState.RUNNING, MissionState.HOLDING, MissionState.PAUSED)
ENDED: Final = (GoalState.REACHED, GoalState.STUCK, GoalState.ABORTED)


def progress_rows(station: Station, width: int) -> list[Row]:
    """Return the distance with the times, and a bar with the share of the way."""
    seen = station.seen(STATUS)
    status: NavigatorStatus | None = live(seen)
    if status is None:
        return [row(head("to go "), aged(seen, lambda _: "")), bar_row(None, (), width, "faint")]
    if status.goal in (GoalState.NONE, GoalState.REFUSED) or not status.goal_id:
        return [row(faint("no goal")), bar_row(None, (), width, "faint")]
    share = station.progress.share
    waypoint = waypoint_words(station)
    after = (Span(f"  {waypoint}", "mission"),) if waypoint else ()
    return [
        row(head("to go "), *way_spans(station, status, seen, width)),
        bar_row(share, after, width, role_of(seen, "goal")),
    ]


def way_spans(station: Station, status: NavigatorStatus, seen: AgedMessage, width: int) -> Row:
    """Return distance, time so far and time left; the outcome when the goal has ended."""
    role = role_of(seen)
    so_far = f"{since_set_s(status):.1f} s"
    if status.goal in ENDED:
        words = f"{end_words(status)} {so_far}{doubt_after(station, status)}"
        return row(Span(f"{number(status.goal_distance_m)} m  {words}", role))
    left_s = station.progress.left_s
    left = MISSING if left_s is None else f"~{left_s:.0f}"
    return row(
        Span(f"{number(status.goal_distance_m, '5.2f')} m ", role),
        Span(f"{so_far:>7} {'so far ' if width >= FULL else ''}", role_of(seen, "faint")),
        Span(f"{left:>4} s left", role),
    )


def end_words(status: NavigatorStatus) -> str:
    """Return how the goal ended, as the beginning of a duration."""
    end = goal_end(status.goal, status.goal_reason)
    return "reached in" if end == "reached" else f"{end} after"


def doubt_after(station: Station, status: NavigatorStatus) -> str:
    """Return the doubt about the position of a robot that is lost, else an empty text."""
    pose: PlanarOdometry | None = live(station.seen(ODOMETRY))
    if goal_end(status.goal, status.goal_reason) != LOST:
        return ""
    return f", {doubt_words(None if pose is None else doubt_of(pose))}"


def bar_row(share: float | None, after: Row, width: int, role: str) -> Row:
    """Return a bar in the whole width, with the share in percent and what follows it."""
    percent = f" {MISSING if share is None else f'{100.0 * share:.0f}':>3} %"
    cells = max(LEAST_BAR, width - len(percent) - width_of(after))
    return row(Span(bar(share or 0.0, cells), role), Span(percent, role), *after)


def since_set_s(status: NavigatorStatus) -> float:
    """Return the time since the goal was set, held time included, by the robot's clock."""
    until_ns = status.goal_ended_ns or status.time_ns
    return (until_ns - status.goal_started_ns) / NS_PER_S


def waypoint_words(station: Station) -> str:
    """Return which waypoint of the mission is under way; empty without a running mission."""
    status = live(station.seen(MISSION))
    if not isinstance(status, MissionStatus) or status.state not in UNDER_WAY:
        return ""
    return f"waypoint {min(status.current + 1, status.count)} of {status.count}"


GOOD_PERCENT: Final = 99.0
MARKS: Final = {"ok": "●", "caution": "▲", "danger": "○", "faint": "○"}


class Health(NamedTuple):
    """A part of the system: its state as a role, and its details for wide panels."""

    name: str
    role: str
    detail: str


def health_rows(station: Station, recording: str, width: int) -> list[Row]:
    """Return the row; details are left out where they do not fit."""
    parts = [link(station), senses(station), loop(station), recorder(recording)]
    for detailed in (True, False):
        spans: list[Span] = []
        for part in parts:
            mark = Span(f"{MARKS[part.role]} ", part.role)
            is_known = detailed and part.detail
            spans += [
                mark,
                Span(part.name),
                faint(f" {part.detail}" if is_known else ""),
                Span("  "),
            ]
        found = row(*spans[:-1])
        if width_of(found) <= width:
            break
    return [found]


def link(station: Station) -> Health:
    """Judge the link by the heartbeat and the share of received frames."""
    percent, trip_ms = station.link_percent, station.round_trip_ms
    if station.seen(HEARTBEAT).age is Age.GONE:
        return Health("link", "danger", MISSING)
    good = percent is not None and percent >= GOOD_PERCENT
    detail = f"{number(trip_ms, '3.0f')} ms" if station.live else ""
    return Health("link", "ok" if good or not station.live else "caution", detail)


def senses(station: Station) -> Health:
    """Judge the sonars by their age, and by those that give no reading."""
    cycle: CycleReport | None = live(station.seen(CYCLE))
    dead = dead_sonars(station)
    if station.seen(SONAR).age is Age.GONE:
        return Health("senses", "danger", MISSING)
    if dead:
        return Health("senses", "caution", f"{', '.join(dead)} dead")
    age = "" if cycle is None else f"{cycle.sense_age_us / 1000:3.0f} ms"
    return Health("senses", "ok", age)


def loop(station: Station) -> Health:
    """Judge the control loop by the most expensive cycle of the last second."""
    cycle: CycleReport | None = live(station.seen(CYCLE))
    if cycle is None:
        return Health("loop", "danger", MISSING)
    worst = station.worst_cycle or cycle
    over = sum(worst.stage_us) > worst.budget_us
    return Health("loop", "caution" if over else "ok", f"{cycle.missed} missed")


def recorder(words: str) -> Health:
    """Judge the recording by its word in the status line; `!` marks one that does not grow."""
    if not words:
        return Health("rec", "faint", "off")
    return Health("rec", "danger" if words.endswith("!") else "ok", "")


SAME_CLOCK_S: Final = 0.25
"""Stamps of truth and estimate further apart than this are from different clocks."""
RULE: Final = "─"


class SideForm(NamedTuple):
    """Rows of the sentence, of sparklines and of sonar bars; `ruled`: lines between the parts."""

    sentence: int
    sparks: int
    bars: int
    ruled: bool = False
    mission: bool = True

    def rows(self, place: int, mission: int) -> int:
        """Return the number of rows with so many rows of the place and the mission."""
        shown = mission if self.mission else 0
        parts = [self.sentence, 2, place, self.sparks, self.bars + 2, shown, 1]
        rules = sum(part > 0 for part in parts) - 1 if self.ruled else 0
        return sum(parts) + rules


FORMS: Final = (
    SideForm(3, 6, 6, ruled=True),
    SideForm(3, 4, 6, ruled=True),
    SideForm(3, 4, 5, ruled=True),
    SideForm(3, 4, 3, ruled=True),
    SideForm(3, 4, 2, ruled=True),
    SideForm(3, 4, 3),
    SideForm(3, 2, 3),
    SideForm(3, 2, 2),
    SideForm(3, 2, 1),
    SideForm(3, 2, 1, mission=False),
    SideForm(2, 2, 1, mission=False),
    SideForm(2, 0, 1, mission=False),
    SideForm(2, 0, 0, mission=False),
    SideForm(1, 0, 0, mission=False),
)
"""From the largest to the smallest; the first that fits is taken."""


class SidePanel:
    """Makes the rows of the side panel; keeps what is renewed slowly."""

    def __init__(self) -> None:
        self._sentence = Sentence()
        self._sparks: tuple[object, list[Row]] = (None, [])

    def rows(
        self, station: Station, height: int, width: int, *, recording: str = "", draft: int = 0
    ) -> list[Row]:
        """Return at most `height` rows, in the largest form that fits.

        `draft` is the number of waypoints that the robot has not received.
        """
        place, mission = place_rows(station), [*mission_rows(station), *draft_rows(draft)]
        form = form_for(height, len(place), len(mission))
        parts = [
            self._sentence.rows(station, width, form.sentence),
            progress_rows(station, width),
            place,
            self._spark_rows(station, width, form.sparks),
            sonar_rows(station, width, form.bars),
            mission if form.mission else [],
            health_rows(station, recording, width),
        ]
        rows: list[Row] = []
        for part in filter(None, parts):
            if rows and form.ruled:
                rows.append(row(Span(RULE * width, "rule")))
            rows += part
        return [cut(one, width) for one in rows[:height]]

    def _spark_rows(self, station: Station, width: int, most: int) -> list[Row]:
        """Return the sparklines, renewed twice a second: they read a minute of values."""
        key = station.robot, id(station), width, most, station.now_ns // RENEWED_NS
        if key != self._sparks[0]:
            self._sparks = key, spark_rows(station, width, most)
        return self._sparks[1]

    def fitting(self, station: Station, height: int, draft: int) -> int:
        """Return the rows of the largest form that fits into `height` rows."""
        place, mission = len(place_rows(station)), len(mission_rows(station)) + (draft > 0)
        return form_for(height, place, mission).rows(place, mission)


def form_for(height: int, place: int, mission: int) -> SideForm:
    """Return the largest form that fits into so many rows, else the smallest."""
    return next((form for form in FORMS if form.rows(place, mission) <= height), FORMS[-1])


def place_rows(station: Station) -> list[Row]:
    """Return goal, pose with its doubt, the true error in a simulation, and a board if any."""
    odometry, status = station.seen(ODOMETRY), station.seen(STATUS)
    error_m, remedy = true_error_m(station), station.place_remedy
    rows = [
        row(head("goal "), aged(status, goal_words, "goal")),
        row(head("pose "), aged(odometry, pose_words, "danger" if remedy else "text")),
        *([row(head("     "), Span(f":{remedy}", "caution"))] if remedy else []),
    ]
    if error_m is not None:
        words = f"true error {error_m * MM_PER_M:.0f} mm"
        rows.append(row(head("     "), Span(words, role_of(odometry, "true robot"))))
    return [*rows, *board_rows(station)]


def pose_words(odometry: PlanarOdometry) -> str:
    """Return x, y, heading and the estimated error (one standard deviation) as text."""
    if not knows_place(odometry):
        return PLACE_UNKNOWN
    deg = degrees(odometry.heading_rad)
    doubt = f"±{number(uncertainty_m(odometry) * MM_PER_M, '.0f')} mm"
    place = f"{number(odometry.x_m, '6.2f')} {number(odometry.y_m, '6.2f')}"
    return f"{place}  {number(deg, '4.0f')}° {doubt}"


def goal_words(status: NavigatorStatus) -> str:
    """Return the goal as text."""
    if status.goal == GoalState.NONE:
        return "none"
    heading = number(degrees(status.goal_heading_rad), "4.0f", " any")
    degree = "°" if isfinite(status.goal_heading_rad) else ""
    return f"{number(status.goal_x_m, '6.2f')} {number(status.goal_y_m, '6.2f')}  {heading}{degree}"


def true_error_m(station: Station) -> float | None:
    """Return the distance between the estimate and the truth; None without a live truth.

    The truth is moved to the time of the estimate, because both arrive at different times.
    """
    truth: GroundTruth | None = live(station.seen(TRUTH))
    odometry: PlanarOdometry | None = live(station.seen(ODOMETRY))
    if truth is None or odometry is None or not knows_place(odometry):
        return None
    later_s = (odometry.time_ns - truth.time_ns) / NS_PER_S
    if abs(later_s) > SAME_CLOCK_S:
        later_s = 0.0
    ahead_m = truth.speed_m_s * later_s
    x_m = truth.x_m + ahead_m * cos(truth.heading_rad)
    y_m = truth.y_m + ahead_m * sin(truth.heading_rad)
    error_m = hypot(odometry.x_m - x_m, odometry.y_m - y_m)
    return error_m if isfinite(error_m) else None
