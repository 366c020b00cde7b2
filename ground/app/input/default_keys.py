"""Define the table of keys: a stable id, default keys, and the layer where they are active."""

from enum import Enum
from typing import Final, NamedTuple


class Layer(Enum):
    """The place where a key is active.

    When several layers are active, the first one here takes the key.
    """

    ALWAYS = "everywhere"
    STOP = "while nothing is typed"
    TELEOP = "teleop"
    TYPING = "command line"
    FILTER = "filter of a list"
    CURSOR = "cursor on the map"
    LIST = "list"
    DRIVE = "map"
    REPLAY = "replay"
    PLOTS = "plots"
    PARAMS = "parameters"
    LOG = "log"
    WORLDS = "worlds"
    FAULTS = "faults"
    ROBOT = "robot"
    FLEET = "robot, on every screen"
    STATION = "station"


class KeyBinding(NamedTuple):
    """A row of the table; `short` is the name on the key bar, if the key is shown there."""

    id: str
    keys: tuple[str, ...]
    description: str
    layer: Layer
    short: str = ""

    @property
    def may_move(self) -> bool:
        """True if it can move a robot, release its emergency stop, or replace the robot."""
        return self.layer in (Layer.CURSOR, Layer.TELEOP, Layer.ROBOT) or self.id in MOVING


MOVING: Final = ("clear-estop", "teleop", "world-start", "fault-begin")
"""Ids of keys that can move a robot, besides those of the layers that command it."""


def _keys(layer: Layer, *rows: tuple[str, str, str, str]) -> tuple[KeyBinding, ...]:
    return tuple(KeyBinding(row[0], tuple(row[1].split()), row[2], layer, row[3]) for row in rows)


KEYS: Final[tuple[KeyBinding, ...]] = (
    *_keys(
        Layer.ALWAYS,
        ("estop", "f12 ctrl+space", "emergency stop; twice within 1 s: of all robots", ""),
        ("quit", "ctrl+q", "leave the ground station", ""),
    ),
    *_keys(
        Layer.STOP,
        ("estop-here", "space", "emergency stop; twice within 1 s: of all robots", "E-STOP"),
        ("estop-all", "S", "emergency stop of all robots", ""),
    ),
    *_keys(
        Layer.TELEOP,
        ("teleop-end", "escape", "end teleop, as any other key does", "End"),
        ("teleop-forward", "up w", "drive forward", "Forward"),
        ("teleop-back", "down s", "drive back", "Back"),
        ("teleop-left", "left a", "turn left", "Left"),
        ("teleop-right", "right d", "turn right", "Right"),
        ("teleop-forward-slow", "shift+up W", "forward, slowly", "Slowly"),
        ("teleop-back-slow", "shift+down", "back, slowly", ""),
        ("teleop-left-slow", "shift+left A", "left, slowly", ""),
        ("teleop-right-slow", "shift+right D", "right, slowly", ""),
    ),
    *_keys(
        Layer.TYPING,
        ("complete", "tab", "complete the word, then go through the completions", "Complete"),
        ("complete-before", "shift+tab", "previous completion", ""),
        ("history-search", "ctrl+r", "search the earlier commands", "Search"),
        ("history-back", "up", "previous command", "Previous"),
        ("history-on", "down", "next command", ""),
        ("leave-line", "escape", "back to the map", "Back"),
    ),
    *_keys(
        Layer.FILTER,
        ("filter-up", "up", "one row up", ""),
        ("filter-down", "down", "one row down", ""),
        ("filter-drop", "escape", "clear the filter", "Clear"),
    ),
    *_keys(
        Layer.CURSOR,
        ("cursor-up", "up", "cursor up", ""),
        ("cursor-down", "down", "cursor down", ""),
        ("cursor-left", "left", "cursor left", ""),
        ("cursor-right", "right", "cursor right", ""),
        ("cursor-up-far", "shift+up", "ten steps up", ""),
        ("cursor-down-far", "shift+down", "ten steps down", ""),
        ("cursor-left-far", "shift+left", "ten steps left", ""),
        ("cursor-right-far", "shift+right", "ten steps right", ""),
        ("cursor-turn-left", "<", "turn the goal's heading left", ""),
        ("cursor-turn-right", ">", "turn the goal's heading right", "Heading"),
        ("cursor-heading-free", "backspace", "accept any heading", ""),
        ("goal-at-cursor", "enter", "drive to the cursor", "Go"),
        ("waypoint", "w", "add a waypoint at the cursor", "Waypoint"),
        ("map-menu", "m", "menu of this place: go, waypoint, measure, look", "Menu"),
        ("leave-cursor", "escape", "remove the cursor", "Close"),
    ),
    *_keys(
        Layer.LIST,
        ("row-up", "up k", "one row up", ""),
        ("row-down", "down j", "one row down", ""),
        ("page-up", "pageup ctrl+b", "a page up", ""),
        ("page-down", "pagedown ctrl+f", "a page down", ""),
        ("row-first", "home", "the first row", ""),
        ("row-last", "end", "the last row", ""),
        ("row-choose", "enter", "change the value", ""),
        ("undo-here", "z", "undo the last change: Enter confirms", ""),
        ("sort", "o", "sort by the next column", "Sort"),
        ("sort-turn", "O", "reverse the order", ""),
    ),
    *_keys(
        Layer.DRIVE,
        ("cursor", "G up down left right", "place a goal cursor on the map", "Cursor"),
        ("zoom-in", "+ =", "zoom in", ""),
        ("zoom-out", "-", "zoom out", ""),
        ("fit", "0", "show the whole world", ""),
        ("centre", "c", "centre the map on the robot", ""),
        ("follow", "f", "follow the robot, or stop following", ""),
        ("layers", "z", "choose the layers of the map", ""),
        ("explain", "e", "explain the last turn", "Why"),
        ("explain-before", "E", "explain the turn before", ""),
        ("ghost", "n", "simulate another navigator from here", ""),
        ("teleop", "t", "drive by keys", "Teleop"),
    ),
    *_keys(
        Layer.REPLAY,
        ("replay-back", ",", "one step back", ""),
        ("replay-on", ".", "one step forward", "Step"),
        ("replay-play", "p", "play or pause", "Play"),
        ("replay-slower", "<", "half the speed", ""),
        ("replay-faster", ">", "twice the speed", ""),
        ("replay-mark", "M", "to the next mark", "Mark"),
        ("replay-jump-back", "pageup", "ten seconds back", ""),
        ("replay-jump-on", "pagedown", "ten seconds forward", ""),
        ("replay-begin", "home", "to the beginning", ""),
        ("replay-open", "o", "open a recording", "Open"),
        ("replay-end", "end", "to the end", ""),
    ),
    *_keys(
        Layer.PLOTS,
        ("plot-shorter", "+ =", "show half the time span", "Shorter"),
        ("plot-longer", "-", "show twice the time span", "Longer"),
        ("plot-choose", "e", "choose what is plotted", "Series"),
        ("plot-pause", "p", "pause, or go on", "Pause"),
        ("plot-cursor-left", "left", "cursor left: show the values there", "Cursor"),
        ("plot-cursor-right", "right", "cursor right", ""),
        ("plot-cursor-left-far", "shift+left", "ten steps left", ""),
        ("plot-cursor-right-far", "shift+right", "ten steps right", ""),
    ),
    *_keys(
        Layer.PARAMS,
        ("param-edit", "e", "change the value", "Edit"),
        ("param-default", "d", "back to the default", "Default"),
        ("param-diff", "f", "show only changed values", "Changed"),
        ("param-read", "u", "read all parameters again", "Read"),
    ),
    *_keys(
        Layer.LOG,
        ("log-follow", "f", "follow the newest line, or pause", "Follow"),
        ("log-severity", "s", "show warnings, errors, or everything", "Severity"),
        ("find-next", "n", "next match", "Next"),
        ("find-before", "N", "previous match", ""),
    ),
    *_keys(
        Layer.WORLDS,
        ("world-start", "s", "stop the processes and start this world", "Start"),
    ),
    *_keys(
        Layer.FAULTS,
        ("fault-begin", "s", "inject this fault", "Inject"),
    ),
    *_keys(
        Layer.ROBOT,
        ("hold", "h", "stop, keep the goal; needs no lease", "Hold"),
        ("resume", "r", "drive on to the goal", "Resume"),
        ("abort", "x", "stop, drop the goal or mission; needs no lease", "Abort"),
        ("missions", "W", "send the draft, start the mission, or list it", "Mission"),
        ("arm", "a", "arm the motors", "Arm"),
        ("disarm", "A", "disarm the motors; needs no lease", ""),
        ("mode", "m", "choose the mode", "Mode"),
        ("navigator", "v", "choose the navigator", "Algo"),
        ("side", "b", "choose the side to pass obstacles on", ""),
        ("rtl", "R", "return along the robot's trail", "RTL"),
        ("lease", "L", "take the lease, or give it back", ""),
        ("place", "i", "set the pose of the robot", ""),
    ),
    *_keys(
        Layer.FLEET,
        ("clear-estop", "D", "release the emergency stop: press twice", ""),
        ("goal", "g", "type a goal", "Goal"),
        ("undo", "ctrl+z", "take back the last change of a parameter, the fence or the draft", ""),
        ("robot-before", "[", "previous robot", ""),
        ("robot-next", "]", "next robot", ""),
    ),
    *_keys(
        Layer.STATION,
        ("screen-1", "1", "Drive", ""),
        ("screen-2", "2", "Plots", ""),
        ("screen-3", "3", "Params", ""),
        ("screen-4", "4", "Log", ""),
        ("screen-5", "5", "Links", ""),
        ("screen-6", "6", "Worlds", ""),
        ("screen-7", "7", "Faults", ""),
        ("screen-8", "8", "Replay", ""),
        ("jump", "ctrl+o", "jump to a screen", ""),
        ("close", "escape", "close what is open", ""),
        ("next-panel", "tab", "next panel", ""),
        ("panel-before", "shift+tab", "previous panel", ""),
        ("command", ":", "type a command", "Command"),
        ("find", "/", "filter the list", "Filter"),
        ("palette", "ctrl+p", "command palette", "Palette"),
        ("help", "? f1", "keys that are active now", "Help"),
        ("copy", "y", "copy the last action as a command line, or the row of a list", ""),
        ("shot", "Y", "save the screen as an SVG", ""),
        ("share", "Z", "put the run into one .zip", ""),
        ("theme", "T", "next theme", ""),
        ("quit-hint", "q ctrl+c", "say which key leaves", ""),
    ),
)
