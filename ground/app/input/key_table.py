"""The table of keys: an id that never changes, the keys it has by default, and where it counts."""

from enum import Enum
from typing import Final, NamedTuple


class Layer(Enum):
    """Where a key counts. Of those that count at a moment the first named here comes first."""

    ALWAYS = "everywhere"
    STOP = "while nothing is typed"
    TELEOP = "teleop"
    TYPING = "command line"
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
    STATION = "station"


class KeyBinding(NamedTuple):
    """`short`: how the key bar calls it, when it is to be there."""

    id: str
    keys: tuple[str, ...]
    says: str
    layer: Layer
    short: str = ""


def _keys(layer: Layer, *rows: tuple[str, str, str, str]) -> tuple[KeyBinding, ...]:
    return tuple(KeyBinding(row[0], tuple(row[1].split()), row[2], layer, row[3]) for row in rows)


KEYS: Final[tuple[KeyBinding, ...]] = (
    *_keys(
        Layer.ALWAYS,
        ("estop", "f12 ctrl+space", "emergency stop, until it is acknowledged", ""),
        ("quit", "ctrl+q", "leave the ground station", ""),
    ),
    *_keys(Layer.STOP, ("estop-here", "space", "emergency stop", "E-STOP")),
    *_keys(
        Layer.TELEOP,
        ("teleop-forward", "up w", "drive forward", "Forward"),
        ("teleop-back", "down s", "drive back", "Back"),
        ("teleop-left", "left a", "turn left", "Left"),
        ("teleop-right", "right d", "turn right", "Right"),
        ("teleop-forward-slow", "shift+up W", "forward, slowly", "Slowly"),
        ("teleop-back-slow", "shift+down S", "back, slowly", ""),
        ("teleop-left-slow", "shift+left A", "left, slowly", ""),
        ("teleop-right-slow", "shift+right D", "right, slowly", ""),
    ),
    *_keys(
        Layer.TYPING,
        ("complete", "tab", "complete the word", "Complete"),
        ("history-back", "up", "the command before", "Before"),
        ("history-on", "down", "the command after", ""),
        ("leave-line", "escape", "back to the map", "Back"),
    ),
    *_keys(
        Layer.CURSOR,
        ("cursor-up", "up k", "cursor up", "Up"),
        ("cursor-down", "down j", "cursor down", "Down"),
        ("cursor-left", "left h", "cursor left", "Left"),
        ("cursor-right", "right l", "cursor right", "Right"),
        ("cursor-up-far", "shift+up K", "ten steps up", ""),
        ("cursor-down-far", "shift+down J", "ten steps down", ""),
        ("cursor-left-far", "shift+left H", "ten steps left", ""),
        ("cursor-right-far", "shift+right L", "ten steps right", ""),
        ("cursor-turn-left", "<", "turn the goal's heading left", ""),
        ("cursor-turn-right", ">", "turn the goal's heading right", "Heading"),
        ("cursor-heading-free", "backspace", "any heading will do", ""),
        ("goal-at-cursor", "enter", "drive to the cursor", "Go"),
        ("waypoint", "w", "add a waypoint at the cursor", "Waypoint"),
        ("leave-cursor", "escape", "put the cursor away", "Away"),
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
    ),
    *_keys(
        Layer.DRIVE,
        ("cursor", "G up down left right", "a goal cursor on the map", "Cursor"),
        ("zoom-in", "+ =", "nearer", ""),
        ("zoom-out", "-", "farther", ""),
        ("fit", "0", "the whole world", ""),
        ("centre", "c", "the robot in the middle", ""),
        ("follow", "f", "keep the robot in the middle, or not", ""),
        ("layers", "z", "what the map shows", ""),
        ("explain", "e", "why did it turn?", "Why"),
        ("explain-before", "E", "and the time before that?", ""),
        ("ghost", "n", "another navigator from here, as a ghost", ""),
        ("teleop", "t", "drive by hand", "Teleop"),
    ),
    *_keys(
        Layer.REPLAY,
        ("replay-back", ",", "one step back", ""),
        ("replay-on", ".", "one step on", "Step"),
        ("replay-play", "p", "play or pause", "Play"),
        ("replay-slower", "<", "half the speed", ""),
        ("replay-faster", ">", "twice the speed", ""),
        ("replay-mark", "M", "to the next mark", "Mark"),
        ("replay-jump-back", "pageup", "ten seconds back", ""),
        ("replay-jump-on", "pagedown", "ten seconds on", ""),
        ("replay-begin", "home", "to the beginning", ""),
        ("replay-open", "o", "open a recording", "Open"),
        ("replay-end", "end", "to the end", ""),
    ),
    *_keys(
        Layer.PLOTS,
        ("plot-shorter", "+ =", "half the time", "Shorter"),
        ("plot-longer", "-", "twice the time", "Longer"),
    ),
    *_keys(
        Layer.PARAMS,
        ("param-edit", "e", "change the value", "Edit"),
        ("param-default", "d", "back to the default", "Default"),
        ("param-diff", "f", "only what differs from its default", "Differs"),
        ("param-read", "u", "read them again", "Read"),
    ),
    *_keys(
        Layer.LOG,
        ("log-follow", "f", "follow the newest line, or stay", "Follow"),
        ("log-severity", "s", "only warnings, only errors, all", "Severity"),
        ("find-next", "n", "the next find", "Next"),
        ("find-before", "N", "the find before", ""),
    ),
    *_keys(
        Layer.WORLDS,
        ("world-start", "s", "end what runs, and start this world", "Start"),
    ),
    *_keys(
        Layer.FAULTS,
        ("fault-begin", "s", "let this go wrong", "Begin"),
    ),
    *_keys(
        Layer.ROBOT,
        ("clear-estop", "D", "release the emergency stop: press twice", ""),
        ("hold", "h", "stand still, keep the goal", "Hold"),
        ("resume", "r", "go on to the goal", "Resume"),
        ("abort", "x", "drop the goal or mission, stand still", "Abort"),
        ("goal", "g", "type a goal", "Goal"),
        ("missions", "W", "the mission: list, load, start", "Mission"),
        ("arm", "a", "let the wheels turn", "Arm"),
        ("disarm", "A", "do not let the wheels turn", ""),
        ("mode", "m", "choose the mode", "Mode"),
        ("navigator", "v", "choose the navigator", "Algo"),
        ("side", "b", "on which side obstacles are passed", ""),
        ("rtl", "R", "back along the robot's own trail", "RTL"),
        ("lease", "L", "take or release the command", ""),
        ("robot-before", "[", "the robot before", ""),
        ("robot-next", "]", "the next robot", ""),
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
        ("next-panel", "tab", "the next panel", ""),
        ("panel-before", "shift+tab", "the panel before", ""),
        ("command", ":", "type a command", "Command"),
        ("find", "/", "find", ""),
        ("palette", "ctrl+p", "everything by name", "Palette"),
        ("help", "? f1", "the keys that count now", "Help"),
        ("copy", "y", "copy the last action as a command line", ""),
        ("shot", "Y", "save the screen as an SVG", ""),
        ("theme", "T", "the next theme", ""),
    ),
)
