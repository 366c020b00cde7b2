"""Make the side panel of the Drive screen: what the robot does, where it is, what it senses."""

from math import cos, degrees, hypot, isfinite, sin
from typing import Final, NamedTuple

from ground.app.panels.aged import aged, live, number, role_of
from ground.app.panels.board import board_rows
from ground.app.panels.health import health_rows
from ground.app.panels.mission import draft_rows, mission_rows
from ground.app.panels.progress import progress_rows
from ground.app.panels.sentence import RENEWED_NS, Sentence
from ground.app.panels.sonar import sonar_rows
from ground.app.widgets.rows import Row, Span, cut, head, row
from ground.app.widgets.sparklines import spark_rows
from ground.client.status_line import PLACE_UNKNOWN, knows_place
from ground.station.history.telemetry_history import uncertainty_m
from ground.station.station import Station
from protocol.topics import ODOMETRY, STATUS, TRUTH
from protocol.wire.enums import GoalState
from protocol.wire.messages import GroundTruth, NavigatorStatus, PlanarOdometry
from runtime.units import NS_PER_S

MM_PER_M: Final = 1000.0
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
