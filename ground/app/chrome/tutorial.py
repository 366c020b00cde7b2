"""Guide an operator through the first drive, step by step, and check that each step was done."""

from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

from ground.app.panels.aged import live
from ground.station.station import Station
from protocol.topics import MISSION, STATUS
from protocol.wire.enums import GoalState, MissionState, Vehicle
from protocol.wire.messages import MissionStatus, NavigatorStatus

DRAFT: Final = 2
STARTED: Final = (
    *(MissionState.RUNNING, MissionState.HOLDING, MissionState.PAUSED, MissionState.DONE),
)
SENT: Final = (MissionState.READY, *STARTED)
UNDER_WAY: Final = (GoalState.DRIVING, GoalState.AVOIDING, GoalState.ALIGNING, GoalState.REACHED)


class TutorialFacts(NamedTuple):
    """What the steps are checked by; `first_goal` is the goal at the beginning."""

    status: NavigatorStatus
    mission: int
    draft: int
    first_goal: int


class TutorialStep(NamedTuple):
    """A step in words, with keys by their ids in braces, and the check that it was done."""

    text: str
    is_done: Callable[[TutorialFacts], bool]


STEPS: Final = (
    TutorialStep(
        "watch the robot drive to the goal ◎ by itself",
        lambda now: now.status.goal == GoalState.REACHED,
    ),
    TutorialStep(
        "a goal of your own: press {goal}, type 1 1 (metres), press enter, and watch",
        lambda now: now.status.goal == GoalState.REACHED and now.status.goal_id != now.first_goal,
    ),
    TutorialStep(
        "draft a mission: {cursor} shows a cursor, arrows move it, {waypoint} adds a waypoint;"
        " add two in free places",
        lambda now: now.draft >= DRAFT or now.mission in SENT,
    ),
    TutorialStep("send the draft to the robot: press {missions}", lambda now: now.mission in SENT),
    TutorialStep("start the mission: press {missions} again", lambda now: now.mission in STARTED),
    TutorialStep(
        "stop the robot: press {estop_here}",
        lambda now: now.status.vehicle == Vehicle.EMERGENCY_STOP,
    ),
    TutorialStep(
        "clear the stop: press {clear_estop} {clear_estop}",
        lambda now: now.status.vehicle != Vehicle.EMERGENCY_STOP,
    ),
    TutorialStep(
        "arm with {arm}; if the mission was stopped, {resume} goes on",
        lambda now: now.status.vehicle == Vehicle.ACTIVE,
    ),
)
END: Final = "all done. {help} shows all keys, {quit} leaves; next: sidestep up --world u_trap"
KeyOf = Callable[[str], str]


def filled(text: str, key_of: KeyOf) -> str:
    """Return a text with the keys in force."""
    return text.format_map(KeyNames(key_of))


class KeyNames(dict[str, str]):
    """The keys of actions, by ids with underscores."""

    def __init__(self, key_of: KeyOf) -> None:
        super().__init__()
        self._key_of = key_of

    def __missing__(self, id: str) -> str:
        return self._key_of(id.replace("_", "-"))


def outline(key_of: KeyOf) -> Iterator[str]:
    """Yield all steps as numbered lines, for a reader without the screen."""
    for number, step in enumerate(STEPS, start=1):
        yield f"{number}. {filled(step.text, key_of)}"
    yield filled(END, key_of)


class Tutorial:
    """Knows the present step, and goes to the next one when it was done."""

    def __init__(self, key_of: KeyOf) -> None:
        self._key_of = key_of
        self._first_goal: int | None = None
        self.at = 0

    def poll(self, station: Station, draft: int) -> None:
        """Check the present step."""
        status = live(station.seen(STATUS))
        if self.at == len(STEPS) or not isinstance(status, NavigatorStatus):
            return
        if self._first_goal is None:
            self._first_goal = status.goal_id
        mission = live(station.seen(MISSION))
        state = mission.state if isinstance(mission, MissionStatus) else int(MissionState.NONE)
        if STEPS[self.at].is_done(TutorialFacts(status, state, draft, self._first_goal)):
            self.at += 1

    @property
    def words(self) -> str:
        """The present step with its number, or the end."""
        if self.at == len(STEPS):
            return f"TUTORIAL  {filled(END, self._key_of)}"
        text = filled(STEPS[self.at].text, self._key_of)
        return f"TUTORIAL {self.at + 1} of {len(STEPS)}  {text}"
