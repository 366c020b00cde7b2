"""Define the actions that every screen has: stops, commands to the robot, and leaving the app."""

import os
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

from ground.app.app_interface import AppControl, AppInterface
from ground.app.chrome.key_bar import mission_is_ready, unsent
from ground.app.input.key_queue import SecondPress, confirmation
from ground.app.input.keymap import KEYS
from ground.app.panels.aged import live
from ground.app.panels.status import NAMES as NAVIGATOR_NAMES
from ground.app.screens import SCREENS
from ground.app.screens.app_screen import Action
from ground.app.screens.choice import Choice
from ground.app.screens.help import show_help
from ground.app.stops.band import is_in_emergency_stop
from ground.client.telemetry import Age
from ground.client.vocabulary import NAVIGATORS
from ground.commands.command import OperatorCommand, arguments_of
from ground.commands.mission import FetchMission, StartMission, UploadMissionFile
from ground.commands.mode import SetMode
from ground.commands.navigator import SetNavigator
from ground.commands.stop import ClearEmergencyStop
from ground.missions.files import DASH
from ground.station.station import Station
from ground.text.wording import GOAL_MODES, THEMES, few
from ground.user.folders import free_path
from protocol.navigators import USUAL_NAVIGATOR
from protocol.topics import STATUS
from protocol.wire.enums import GoalState, LeaseAction, Mode, Vehicle
from protocol.wire.messages import NavigatorStatus
from runtime.errors import UserError
from runtime.files import replace_named

SHOWN_S: Final = 5.0


class Leaving:
    """Performs the keys that leave the app or look as if they did."""

    def __init__(self, app: AppControl) -> None:
        self._app = app
        self._pressed = SecondPress(lambda: app.station.time_s)

    def quit(self) -> None:
        """Leave at once when all robots stand, else at the second press."""
        ends = ", which ends the simulation" if self._app.stack is not None else ""
        if self._is_confirmed("quit", f"leave{ends}"):
            self._app.exit(0)

    def suspend(self) -> None:
        """Return to the shell until `fg`; at the second press if a robot drives.

        A robot in GUIDED then stops by itself, as this program sends no heartbeat.
        """
        if not has_job_control():
            self._say("no shell waits for this program, so it cannot be suspended")
        elif self._is_confirmed("suspend", "suspend this program: no heartbeat, no view"):
            self._app.suspend_to_shell()

    def _is_confirmed(self, id: str, what: str) -> bool:
        """Return True if all robots stand, or at the second press; else ask for it."""
        driving = robots_that_drive(self._app.station)
        if not driving or self._pressed.is_second(id):
            return True
        drive = "drives" if len(driving) == 1 else "drive"
        self._say(f"{few(driving)} {drive}: {confirmation(self._app.key_shown(id), what)}")
        return False

    def explain(self) -> None:
        """Say which key leaves."""
        self._say(f"{self._app.key_shown('quit')} quits")

    def _say(self, words: str) -> None:
        self._app.note(words)
        self._app.notify(words, severity="warning", timeout=SHOWN_S, markup=False)


def has_job_control() -> bool:
    """Return whether a shell waits for this program, which then is not its session's own group."""
    return os.getpgrp() != os.getsid(0)


def robots_that_drive(station: Station) -> list[str]:
    """Return the robots that drive to a goal or by hand; none in a recording."""
    if not station.live:
        return []
    return [
        entry.robot
        for entry in station.roster()
        if entry.status.age is not Age.GONE
        and isinstance(status := entry.status.message, NavigatorStatus)
        and drives(status)
    ]


def drives(status: NavigatorStatus) -> bool:
    """Return whether a robot is armed, and drives to a goal or by hand."""
    if status.vehicle != Vehicle.ACTIVE:
        return False
    under_way = GoalState.ACCEPTED <= status.goal <= GoalState.ALIGNING
    return status.mode == Mode.MANUAL or (status.mode in GOAL_MODES and under_way)


ALL_WITHIN_S: Final = 1.0
"""A second press within this time stops all robots."""


class StopKeys:
    """Performs the stop keys. Nothing here waits, and nothing rejects a stop."""

    def __init__(self, app: AppInterface) -> None:
        self._app = app

        def time_s() -> float:
            return app.station.time_s

        self._stopping = SecondPress(time_s, ALL_WITHIN_S)
        self._clearing = SecondPress(time_s)

    def actions(self) -> Mapping[str, Callable[[], object]]:
        """Return the actions by the id of their key."""
        return {
            **dict.fromkeys(("estop", "estop-here"), self.stop),
            "estop-all": self.stop_all,
            "clear-estop": self.clear,
        }

    def stop(self) -> None:
        """Stop the selected robot; at the second press within a second, all robots."""
        if self._stopping.is_second():
            self.stop_all()
        else:
            self._app.station.estop()

    def stop_all(self) -> None:
        """Stop all robots that are known."""
        self._app.station.estop_all()

    def clear(self) -> None:
        """Release the emergency stop of the selected robot at the second press.

        A robot whose state is not known may be in one.
        """
        station = self._app.station
        robot = station.robot
        if live(station.seen(STATUS)) is not None and not is_in_emergency_stop(station):
            self._app.note(f"{robot} is not in E-STOP: nothing to clear")
            return
        if self._clearing.is_second(robot):
            self._app.commands.perform(ClearEmergencyStop())
            return
        key = self._app.key_shown("clear-estop")
        self._app.note(confirmation(key, f"clear E-STOP of {robot}"))


NOTHING: Final = "nothing is recorded here, so there is no run to share"


def share_run(app: AppControl) -> None:
    """Write the archive of the played recording, else of this session's; the log says where."""
    if app.player is not None:
        file: Path | None = app.player.path
    else:
        file = None if app.recording is None else app.recording.file
    if file is None:
        app.note(NOTHING)
        return
    app.note(f"shares {file.name}")
    app.run_in_background(lambda: archive(file), app.note)


def archive(file: Path) -> str:
    """Write the archive and return the message with its path; UserError if that fails."""
    from ground.client.outcomes import NoProgress
    from ground.commands.share import Share  # imports the plots; rarely needed

    return f"shared: {Share(file=str(file)).run(NoProgress()).text}"


def saved_picture(svg: str) -> str:
    """Save a picture under the next free name; return its path, or the error, in words."""
    try:
        path = free_path("screen", ".svg")
        replace_named(path, svg)
    except UserError as error:
        return str(error)
    return f"saved {path}"


class RobotKeys:
    """Performs the actions of keys on the app."""

    def __init__(self, app: AppControl) -> None:
        self._app = app
        self._stop_keys = StopKeys(app)
        self._leaving = Leaving(app)

    def actions(self) -> Mapping[str, Action]:
        """Return the actions by id."""
        app = self._app
        screens = {
            f"screen-{number}": partial(app.switch_mode, name) for name, number in SCREENS.items()
        }
        return {
            **{
                key.id: partial(app.commands.perform, key.does)
                for key in KEYS
                if not isinstance(key.does, str)
            },
            **self._stop_keys.actions(),
            **screens,
            "mode": partial(self.choose_value, SetMode, "mode", "mode"),
            "navigator": partial(self.choose_value, SetNavigator, "navigator", "navigator"),
            "side": self.choose_side,
            "missions": self.next_of_mission,
            "lease": self.take_or_release,
            "robot-before": partial(self.select_by, -1),
            "robot-next": partial(self.select_by, 1),
            "robot-attention": self.select_attention,
            "jump": self.choose_screen,
            "palette": app.action_command_palette,
            "help": partial(show_help, app),
            "copy": self.copy,
            "shot": self.save_screenshot,
            "share": partial(share_run, app),
            "theme": self.next_theme,
            "quit": self._leaving.quit,
            "suspend": self._leaving.suspend,
            "quit-hint": self._leaving.explain,
        }

    def choose_value(
        self, kind: type[OperatorCommand], field: str, title: str, **others: Any
    ) -> None:
        """Let the operator choose one value of a command, and perform it with the `others`."""
        argument, current = arguments_of(kind)[field], getattr(self._status(), field, None)
        values = argument.names or {}
        choices = [
            Choice(name, argument.meanings.get(name, ""), is_current=value == current)
            for name, value in values.items()
        ]

        def take(name: str) -> None:
            self._app.commands.perform(kind(**{field: values[name]}, **others))

        self._app.choose(title, choices, take)

    def choose_side(self) -> None:
        """Let the operator choose the side on which to pass obstacles."""
        status = self._status()
        number = -1 if status is None else status.navigator
        navigator = NAVIGATORS[NAVIGATOR_NAMES.get(number, USUAL_NAVIGATOR)]
        self.choose_value(SetNavigator, "side", "side to pass on", navigator=navigator)

    def _status(self) -> NavigatorStatus | None:
        """Return the newest status of the robot, if there is one."""
        newest = self._app.station.telemetry.latest(STATUS)
        return None if newest is None else newest[0]

    def take_or_release(self) -> None:
        """Take the lease, or release it."""
        station = self._app.station
        station.queue.lease(LeaseAction.RELEASE if station.lease.ours else LeaseAction.TAKE)

    def select_by(self, step: int) -> None:
        """Select the robot that is `step` places further in the list."""
        station = self._app.station
        robots = station.robots()
        if len(robots) < 2:
            self._app.note("there is no other robot")
            return
        at = robots.index(station.robot) if station.robot in robots else 0
        station.select(robots[(at + step) % len(robots)])

    def select_attention(self) -> None:
        """Select the next robot that needs attention, the most urgent one first."""
        station = self._app.station
        robots = [entry.robot for entry in station.roster() if entry.needs_attention]
        if not set(robots) - {station.robot}:
            self._app.note("no other robot needs attention")
            return
        at = robots.index(station.robot) + 1 if station.robot in robots else 0
        station.select(robots[at % len(robots)])

    def next_of_mission(self) -> None:
        """Send the draft; else start the mission that was sent; else list the mission."""
        commands, station = self._app.commands, self._app.station
        if unsent(commands.draft_items, station):
            commands.perform(UploadMissionFile(file=DASH))
        elif mission_is_ready(station):
            commands.perform(StartMission())
        else:
            commands.perform(FetchMission())

    # The ground station itself.

    def choose_screen(self) -> None:
        """Let the operator choose a screen."""
        names = [f"{number} {name}" for name, number in SCREENS.items()]

        def go(choice: str) -> None:
            self._app.switch_mode(choice.split()[1])

        self._app.choose("screen", names, go)

    def copy(self) -> None:
        """Copy the last command to the clipboard, as a line for a shell."""
        line = self._app.commands.last
        if line:
            self._app.copy_to_clipboard(line)
        self._app.note(f"copied: {line}" if line else "no command to copy yet")

    def save_screenshot(self) -> None:
        """Save the screen as an SVG file in the folder of pictures."""
        self._app.note(saved_picture(self._app.export_screenshot()))

    def next_theme(self) -> None:
        """Switch to the next theme."""
        at = THEMES.index(self._app.theme) if self._app.theme in THEMES else -1
        self._app.choose_theme(THEMES[(at + 1) % len(THEMES)])
