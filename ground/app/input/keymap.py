"""Define the table of keys, and combine it with the user's file: ids are stable, keys can change.

Each id has default keys and the layer where they are active. All bindings of Textual belong to the
app, so that each key is handled after the one before has changed the focus.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from enum import Enum
from functools import cache
from pathlib import Path
from string import Formatter
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from textual.binding import Binding, BindingsMap

from ground.client.vocabulary import HINTS
from ground.commands.abort import Abort
from ground.commands.arm import Arm
from ground.commands.command import OperatorCommand
from ground.commands.disarm import Disarm
from ground.commands.hold import Hold
from ground.commands.resume import Resume
from ground.commands.rtl import ReturnHome
from ground.console.app_commands import SCREENS, Undo
from protocol.wire.reasons import Reason
from runtime.config import line_located, read_toml, unknown_key
from runtime.errors import ConfigError


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


class Situation(Enum):
    """When a key is what the operator needs next."""

    CURSOR = "a cursor is on the map"
    TELEOP = "the robot is driven by hand"
    FILTERED = "a list is filtered"
    LIST = "a list is shown"
    REPLAY = "a recording is shown"
    STOPPED = "emergency stop"
    WAY_OUT = "the robot has stopped by itself"
    HELD = "the robot stands on its way"
    UNDER_WAY = "the robot drives"
    IDLE = "the robot has no goal"


class Next(NamedTuple):
    """A situation in which a key is shown first, and its place there.

    `name` is its name then, if it is another than usual. `presses` is how often the key must be
    pressed. `others` are ids whose keys are shown, too, such as those of the other directions.
    """

    when: Situation
    rank: int
    name: str = ""
    presses: int = 1
    others: tuple[str, ...] = ()


class KeyBinding(NamedTuple):
    """A row of the table.

    The key performs the command that it `does`, or the action with this id. `short` is its name on
    the key bar, if it is shown there, and `bar` its place behind the keys of the present screen.
    """

    does: OperatorCommand | str
    keys: tuple[str, ...]
    description: str
    layer: Layer
    short: str = ""
    bar: int = 0
    next: tuple[Next, ...] = ()

    @property
    def id(self) -> str:
        """The name of the action in the user's file."""
        return self.does if isinstance(self.does, str) else self.does.verb

    @property
    def may_move(self) -> bool:
        """True if it can move a robot, release its emergency stop, or replace the robot."""
        return self.layer in (Layer.CURSOR, Layer.TELEOP, Layer.ROBOT) or self.id in MOVING

    @property
    def needs_lease(self) -> bool:
        """True if the robot refuses it while another operator commands."""
        return self.id in LEASED if isinstance(self.does, str) else self.does.moves


LEASED: Final = (
    *("goal", "goal-at-cursor", "missions", "mode", "navigator", "side", "place"),
    *("clear-estop", "teleop"),
)
"""Ids of keys without a command of their own that need the lease."""
SET_OFF: Final = ("goal", "goal-at-cursor", "resume", "rtl")
"""Ids of keys that the robot refuses while it does not know its place."""
PROMPTS: Final = (
    *("goal", "goal-at-cursor", "mode", "navigator", "side", "place"),
    *("clear-estop", "teleop"),
)
"""Ids of keys that ask for more, or drive by hand: what is refused does not begin them."""
MOVING: Final = ("clear-estop", "teleop", "world-start", "fault-begin")
"""Ids of keys that can move a robot, besides those of the layers that command it."""


def _keys(layer: Layer, *rows: tuple[Any, ...]) -> tuple[KeyBinding, ...]:
    """Return rows of a layer; what follows the place on the key bar are situations."""
    return tuple(
        KeyBinding(row[0], tuple(row[1].split()), row[2], layer, *row[3:5])._replace(next=row[5:])
        for row in rows
    )


CURSOR, TELEOP, FILTERED, LIST, REPLAY, STOPPED, WAY_OUT, HELD, UNDER_WAY, IDLE = Situation
DIRECTIONS: Final = ("cursor-down", "cursor-left", "cursor-right")
KEYS: Final[tuple[KeyBinding, ...]] = (
    *_keys(
        Layer.ALWAYS,
        ("estop", "f12 ctrl+space", "emergency stop; twice within 1 s: of all robots", ""),
        ("quit", "ctrl+q", "leave the ground station", ""),
        ("suspend", "alt+z", "back to the shell until fg (ctrl+z is undo)", ""),
    ),
    *_keys(
        Layer.STOP,
        ("estop-here", "space", "emergency stop; twice within 1 s: of all robots", "E-STOP"),
        ("estop-all", "S", "emergency stop of all robots", ""),
    ),
    *_keys(
        Layer.TELEOP,
        ("teleop-end", "escape", "end teleop, as any other key does", "End", 0, Next(TELEOP, 1)),
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
        ("cursor-up", "up", "cursor up", "", 0, Next(CURSOR, 3, "Move", others=DIRECTIONS)),
        ("cursor-down", "down", "cursor down", ""),
        ("cursor-left", "left", "cursor left", ""),
        ("cursor-right", "right", "cursor right", ""),
        ("cursor-up-far", "shift+up", "ten steps up", ""),
        ("cursor-down-far", "shift+down", "ten steps down", ""),
        ("cursor-left-far", "shift+left", "ten steps left", ""),
        ("cursor-right-far", "shift+right", "ten steps right", ""),
        ("cursor-turn-left", "<", "turn the goal's heading left", ""),
        ("cursor-turn-right", ">", "turn the goal's heading right", "Heading", 0, Next(CURSOR, 5)),
        ("cursor-heading-free", "backspace", "accept any heading", ""),
        ("goal-at-cursor", "enter", "drive to the cursor", "Go", 0, Next(CURSOR, 1)),
        ("waypoint", "w", "add a waypoint at the cursor", "Waypoint", 0, Next(CURSOR, 2)),
        (
            *("map-menu", "m", "menu of this place: go, waypoint, measure, look", "Menu", 0),
            Next(CURSOR, 4),
        ),
        ("leave-cursor", "escape", "remove the cursor", "Close", 0, Next(CURSOR, 6)),
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
        ("undo-here", "z", "undo the last change: press twice", ""),
        ("sort", "o", "sort by the next column", "Sort"),
        ("sort-turn", "O", "reverse the order", ""),
    ),
    *_keys(
        Layer.DRIVE,
        (
            *("cursor", "G up down left right", "place a goal cursor on the map", "Cursor", 2),
            Next(IDLE, 2),
        ),
        ("zoom-in", "+ =", "zoom in", ""),
        ("zoom-out", "-", "zoom out", ""),
        ("fit", "0", "show the whole world", ""),
        ("centre", "c", "centre the map on the robot", ""),
        ("follow", "f", "follow the robot, or stop following", ""),
        ("layers", "z", "choose the layers of the map", ""),
        ("explain", "e", "explain the last turn", "Why", 9, Next(UNDER_WAY, 3)),
        ("explain-before", "E", "explain the turn before", ""),
        ("ghost", "n", "simulate another navigator from here", ""),
        ("teleop", "t", "drive by keys or a gamepad", "Teleop", 8),
    ),
    *_keys(
        Layer.REPLAY,
        ("replay-back", ",", "one step back", ""),
        ("replay-on", ".", "one step forward", "Step", 0, Next(REPLAY, 2)),
        ("replay-play", "p", "play or pause", "Play", 0, Next(REPLAY, 1)),
        ("replay-slower", "<", "half the speed", ""),
        ("replay-faster", ">", "twice the speed", ""),
        ("replay-mark", "M", "to the next mark", "Mark", 0, Next(REPLAY, 3)),
        ("replay-jump-back", "pageup", "ten seconds back", ""),
        ("replay-jump-on", "pagedown", "ten seconds forward", ""),
        ("replay-begin", "home", "to the beginning", ""),
        ("replay-open", "o", "open a recording", "Open", 0, Next(REPLAY, 4)),
        ("replay-end", "end", "to the end", ""),
    ),
    *_keys(
        Layer.PLOTS,
        ("plot-shorter", "+ =", "show half the time span", "Shorter"),
        ("plot-longer", "-", "show twice the time span", "Longer"),
        ("plot-choose", "e", "choose what is plotted", "Series"),
        ("plot-pause", "p", "pause, or go on", "Pause"),
        ("plot-export", "s", "save one plot as SVG and CSV", "Save"),
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
        (Hold(), "h", "stop, keep the goal; needs no lease", "Hold", 3, Next(UNDER_WAY, 1)),
        (
            *(Resume(), "r", "drive on to the goal", "Resume", 4),
            *(Next(HELD, 1), Next(WAY_OUT, 3, "Go on")),
        ),
        (
            *(Abort(), "x", "stop, end the goal or mission; needs no lease", "Abort", 10),
            *(Next(HELD, 2), Next(UNDER_WAY, 2)),
        ),
        ("missions", "W", "send the draft, start the mission, or list it", "Mission", 11),
        (Arm(), "a", "arm the motors", "Arm", 5, Next(IDLE, 3), Next(WAY_OUT, 2)),
        (Disarm(), "A", "disarm the motors; needs no lease", ""),
        ("mode", "m", "choose the mode", "Mode", 6),
        ("navigator", "v", "choose the navigator", "Algo", 7),
        ("side", "b", "choose the side to pass obstacles on", ""),
        (ReturnHome(), "R", "return along the robot's trail", "RTL", 12),
        ("lease", "L", "take the lease, or give it back", ""),
        ("place", "i", "set the pose of the robot", "", 0, Next(WAY_OUT, 1, "Set the place")),
    ),
    *_keys(
        Layer.FLEET,
        (
            *("clear-estop", "D", "release the emergency stop: press twice", "", 0),
            Next(STOPPED, 1, "Clear E-STOP", presses=2),
        ),
        (
            *("goal", "g", "type a goal", "Goal", 1),
            *(Next(HELD, 3), Next(IDLE, 1), Next(WAY_OUT, 4)),
        ),
        (
            *(Undo(), "ctrl+z"),
            *("take back the last goal, or change of a parameter, the fence or the draft", ""),
        ),
        ("robot-before", "[", "previous robot", ""),
        ("robot-next", "]", "next robot", ""),
        ("robot-attention", "!", "next robot that needs attention, as the roster lists them", ""),
    ),
    *_keys(
        Layer.STATION,
        *((f"screen-{at}", str(at), name.capitalize()) for at, name in enumerate(SCREENS, start=1)),
        ("jump", "ctrl+o", "jump to a screen", ""),
        ("close", "escape", "close what is open", "", 0, Next(FILTERED, 1, "Clear filter")),
        ("next-panel", "tab", "next panel", ""),
        ("panel-before", "shift+tab", "previous panel", ""),
        ("command", ":", "type a command", "Command"),
        ("find", "/", "filter the list", "Filter", 0, Next(LIST, 1)),
        ("palette", "ctrl+p", "command palette", "Palette"),
        ("help", "? f1", "keys that are active now", "Help"),
        ("copy", "y", "copy the last action as a command line, or the row of a list", ""),
        ("shot", "Y", "save the screen as an SVG", ""),
        ("share", "Z", "put the run into one .zip", ""),
        ("theme", "T", "next theme", ""),
        ("quit-hint", "q ctrl+c", "say which key leaves", ""),
    ),
)


TABLE: Final = "keys"
SHOWN: Final[Mapping[str, str]] = MappingProxyType(
    {
        "escape": "esc",
        "pageup": "pgup",
        "pagedown": "pgdn",
        "backspace": "bksp",
        "up": "↑",
        "down": "↓",
        "left": "←",
        "right": "→",
    }
)
TOGETHER: Final = (
    (Layer.STOP, Layer.TELEOP),
    (Layer.TYPING,),
    (Layer.FILTER,),
    (Layer.STOP, Layer.CURSOR),
    (Layer.STOP, Layer.DRIVE, Layer.REPLAY, Layer.ROBOT, Layer.FLEET, Layer.STATION),
    *(
        (Layer.STOP, Layer.LIST, layer, Layer.FLEET, Layer.STATION)
        for layer in (Layer.PLOTS, Layer.PARAMS, Layer.LOG, Layer.WORLDS, Layer.FAULTS)
    ),
)
"""Layers that are active at the same time. The cursor and teleop hide the layers below them: the
operator enters them on purpose, and leaves them with one key."""


@cache
def keys_for(situation: Situation) -> tuple[tuple[KeyBinding, Next], ...]:
    """Return the keys that the operator needs next in a situation, the first one first."""
    found = [(key, one) for key in KEYS for one in key.next if one.when is situation]
    return tuple(sorted(found, key=lambda pair: pair[1].rank))


class Keymap:
    """All keys in force, in the order of the table."""

    def __init__(self, keys: Iterable[KeyBinding] = KEYS) -> None:
        self.keys = tuple(keys)
        self._by_id = {key.id: key for key in self.keys}
        self._found: dict[tuple[Layer, ...], tuple[KeyBinding, ...]] = {}

    def __getitem__(self, id: str) -> KeyBinding:
        return self._by_id[id]

    def of(self, *layers: Layer) -> list[KeyBinding]:
        """Return the keys that are active with these layers, the first layer first.

        Each key appears once.
        """
        if layers not in self._found:
            self._found[layers] = tuple(self._active(layers))
        return list(self._found[layers])

    def _active(self, layers: Iterable[Layer]) -> list[KeyBinding]:
        taken: set[str] = set()
        found: list[KeyBinding] = []
        for layer in layers:
            for key in self.keys:
                free = tuple(word for word in key.keys if word not in taken)
                if key.layer is layer and (free or not key.keys):
                    found.append(key._replace(keys=free))
            taken.update(word for key in found for word in key.keys)
        return found


def load(path: Path | None) -> Keymap:
    """Return the keymap with the user's file. Raise ConfigError when the file is wrong."""
    if path is None:
        return Keymap()
    with line_located(path):
        return keymap_of(read_toml(path), file=str(path))


def keymap_of(table: Mapping[str, Any], *, file: str) -> Keymap:
    """Read `[keys]` with `id = "key"` or `id = ["key", "other"]`; an empty list removes a key."""
    for name in table:
        if name != TABLE:
            raise unknown_key(name, name, [TABLE], file=file)
    chosen = table.get(TABLE, {})
    if not isinstance(chosen, Mapping):
        raise ConfigError(file=file, key=TABLE, reason="not a table", fix="write [keys]")
    known = [key.id for key in KEYS]
    for id in chosen:
        if id not in known:
            raise unknown_key(f"{TABLE}.{id}", id, known, file=file)
    keys = [
        key._replace(keys=_words(chosen[key.id], key.id, file)) if key.id in chosen else key
        for key in KEYS
    ]
    keymap = Keymap(keys)
    _check(keymap, chosen, file)
    return keymap


def _words(value: object, id: str, file: str) -> tuple[str, ...]:
    words = [value] if isinstance(value, str) else value
    if not isinstance(words, list) or not all(isinstance(word, str) and word for word in words):
        fix = 'write "x" or ["x", "f2"]'
        raise ConfigError(file=file, key=f"{TABLE}.{id}", reason="not a key", fix=fix)
    return tuple("space" if word == " " else word for word in words)


def _check(keymap: Keymap, chosen: Iterable[str], file: str) -> None:
    """Raise ConfigError for a key used twice, or an e-stop that cannot be pressed while typing."""
    if not any(len(word) > 1 for word in keymap["estop"].keys):
        fix = "keep one that types no character, such as f12"
        reason = "every key types a character, so it cannot be used on the command line"
        raise ConfigError(file=file, key=f"{TABLE}.estop", reason=reason, fix=fix)
    chosen = set(chosen)
    for first, second, word in clashes(keymap):
        if {first.id, second.id} & chosen:
            mine, other = (first, second) if first.id in chosen else (second, first)
            reason = f"{word!r} is already used by {other.id}"
            fix = f"give {other.id} another key"
            raise ConfigError(file=file, key=f"{TABLE}.{mine.id}", reason=reason, fix=fix)


def clashes(keymap: Keymap) -> list[tuple[KeyBinding, KeyBinding, str]]:
    """Return pairs of ids that share a key while both are active."""
    found: dict[tuple[KeyBinding, KeyBinding, str], None] = {}
    for layers in TOGETHER:
        owners: dict[str, KeyBinding] = {}
        for key in keymap.keys:
            for word in key.keys if key.layer in (Layer.ALWAYS, *layers) else ():
                first = owners.setdefault(word, key)
                if first is not key:
                    found[first, key, word] = None
    return list(found)


def shown(words: Sequence[str]) -> str:
    """Return keys as they are shown to the operator."""
    return " ".join(SHOWN.get(word, word) for word in words)


def as_toml(keymap: Keymap) -> str:
    """Return a file with every id, its keys and its description, as a template for users."""
    lines = ["# Ids and their keys; an id that is left out keeps its keys."]
    for layer in Layer:
        lines += ["", f"# {layer.value}"]
        for key in (key for key in keymap.keys if key.layer is layer):
            words = ", ".join(json.dumps(word) for word in key.keys)
            lines.append(f"{key.id} = [{words}]  # {key.description}")
    return "\n".join(["[keys]", *lines])


REMEDIES: Final[Mapping[int, str]] = MappingProxyType(
    {
        Reason.NOT_ARMED: "`{arm}` arm",
        Reason.EMERGENCY_STOPPED: "`{clear-estop}` clear it: press twice",
        Reason.NEWER_STOP: "`{clear-estop}` clear it: press twice",
        Reason.NO_GOAL: "`{goal}` sets a goal",
        Reason.DRIVING: "`{abort}` abort",
        Reason.NO_SENSES: "`{screen-5}` Links shows what arrives",
        Reason.NO_OPERATOR: "`{screen-5}` Links shows what arrives",
        Reason.NO_MISSION: "`{cursor}`, then `{waypoint}` drafts one, or `:mission upload FILE`",
        Reason.FENCE_UNCHECKED: "`{place}` sets the place, or `:fence off`",
        Reason.PLACE_UNKNOWN: "`{place}` sets the place, or in a simulation `:pose truth`",
        Reason.PARAMETERS_DAMAGED: "see `{screen-3}`, then set one of the safety group",
    }
)
"""The remedy of each refusal; keys by the id of their action."""
SHELL: Final = "sidestep "


def key_hints(keymap: Keymap) -> Mapping[int, str]:
    """Return the remedies of refusals: keys if the keymap has them, otherwise commands."""
    named = {
        reason: words.format_map({id: shown(keymap[id].keys[:1]) for id in ids_in(words)})
        for reason, words in REMEDIES.items()
        if all(keymap[id].keys for id in ids_in(words))
    }
    commands = {reason: in_the_app(words) for reason, words in HINTS.items()}
    return {**commands, **named}


def ids_in(words: str) -> list[str]:
    """Return the ids of actions that a remedy names."""
    return [id for _, id, _, _ in Formatter().parse(words) if id]


def in_the_app(words: str) -> str:
    """Convert a shell command to a command of the app's command line."""
    return f"`:{words.removeprefix(SHELL)}`" if words.startswith(SHELL) else words


NAMES: Final = {",": ("comma",), "ctrl+space": ("ctrl+space", "ctrl+@")}
"""Textual's names of keys: a comma separates keys there, and most terminals send ctrl+@ for
ctrl+space."""


def bindings_of(keymap: Keymap) -> BindingsMap:
    """Return the bindings, the most special layer first; the first active one is used."""
    return BindingsMap(
        [
            Binding(word, f"do('{key.id}')", key.description, show=False, priority=True, id=key.id)
            for layer in Layer
            for key in keymap.keys
            if key.layer is layer
            for word in names_of(key.keys)
        ]
    )


def names_of(words: Iterable[str]) -> list[str]:
    """Return Textual's names of keys."""
    return [name for word in words for name in NAMES.get(word, (word,))]
