"""Name the marks of the map that are on it now, the most important first."""

from typing import Final

from ground.map.glyphs import DOTTED, MARKS
from ground.map.scene import MapScene

NOT_LIVE: Final = "NOT LIVE"
NO_PLACE: Final = "PLACE UNKNOWN"
GAP: Final = "  "
Entry = tuple[str, str]
"""Some words and their role."""


def legend(
    scene: MapScene, room: int, *, ascii_only: bool = False, is_mono: bool = False
) -> list[Entry]:
    """Return as many entries of the legend as fit into `room` columns."""
    found: list[Entry] = []
    for words, role in entries(scene, int(ascii_only), is_mono):
        room -= len(words) + (len(GAP) if found else 0)
        if room < 0:
            break
        found.append((words, role))
    return found


def seen_mark(*, ascii_only: bool, is_mono: bool) -> str:
    """Return the character of echoes: in colour, age is a shade of dots, else a character."""
    return MARKS["seen"][ascii_only] if ascii_only or is_mono else DOTTED


def entries(scene: MapScene, form: int, is_mono: bool = False) -> list[Entry]:
    """Return all entries of a scene; `form` is 0 for Unicode, 1 for ASCII."""
    echo = seen_mark(ascii_only=bool(form), is_mono=is_mono)
    walled = scene.obstacles or scene.size_m
    table = (
        (not scene.live, NOT_LIVE, "text"),
        (not scene.placed, NO_PLACE, "text"),
        (bool(scene.note), scene.note, "text"),
        (scene.robot is not None and scene.live, f"{'▶>'[form]} robot", "robot"),
        (scene.goal is not None, f"{MARKS['goal'][form]} goal", "goal"),
        (scene.has_dead_sonar, f"{MARKS['dead sonar'][form]} dead", "dead sonar"),
        (scene.truth and walled, f"{'─-'[form]} truth", "truth"),
        (scene.true_robot is not None, f"{('○', '()')[form]} true robot", "true robot"),
        (bool(scene.seen or scene.seen_late or scene.seen_old), f"{echo} seen", "seen"),
        (scene.virtual_goal is not None, f"{MARKS['virtual'][form]} virtual", "virtual"),
        (bool(scene.hits or scene.leaves), "H/L hit/leave", "hit"),
        (bool(scene.mission), f"{MARKS['waypoint'][form]} mission", "mission"),
        (bool(scene.others), f"{MARKS['other'][form]} other robots", "other"),
        (bool(scene.movers), f"{MARKS['mover'][form]} moving", "truth"),
        (scene.fence is not None, f"{'⠒.'[form]} fence", "fence"),
        (bool(scene.ghosts), f"{MARKS['ended'][form]} ghost", "ghost"),
    )
    return [(words, role) for shown, words, role in table if shown]
