"""Write a world as the text of a world file, which `plant.world.file` reads as the same world.

Angles are written in degrees. If no decimal number gives exactly the angle, the last bit differs.
"""

import json
from math import degrees, inf, nextafter, radians
from typing import Any, Final

from plant.model.types import World
from plant.world.to_json import tables_of
from runtime.cli.terminal import printable

MAX_DECIMALS: Final = 15


def dumps(world: World, comment: str = "") -> str:
    """Return the text of a world file that begins with a comment."""
    tables = tables_of(world, in_degrees)
    head = {key: tables[key] for key in ("name", "size_m", "walls", "start", "goal")}
    if world.walls:
        del head["walls"]  # the default
    corpus = {
        "family": world.family,
        "seed": world.family_seed,
        "shortest_path_m": world.shortest_path_m,
        "reachable": world.reachable,
    }
    lines = [f"# {printable(line)}".rstrip() for line in comment.splitlines()]
    lines += _pairs(head)
    for header, table in (
        *(("[[obstacle]]", obstacle) for obstacle in tables["obstacles"]),
        *(("[robot]", tables["robot"]), ("[noise]", tables["noise"])),
        *(("[[fault]]", fault) for fault in tables["faults"]),
        ("[corpus]", corpus),
    ):
        if pairs := _pairs(table):
            lines += ["", header, *pairs]
    return "\n".join(lines) + "\n"


def in_degrees(angle_rad: float) -> float:
    """Return the shortest decimal degrees that give exactly this angle, or else the nearest."""
    angle_deg = degrees(angle_rad)
    tries = [round(angle_deg, decimals) for decimals in range(MAX_DECIMALS + 1)]
    below, above = nextafter(angle_deg, -inf), nextafter(angle_deg, inf)
    tries += [angle_deg, below, above, nextafter(below, -inf), nextafter(above, inf)]
    return next((one for one in tries if radians(one) == angle_rad), angle_deg)


def _pairs(table: dict[str, Any]) -> list[str]:
    """Return a table's assignments, without the unknown values."""
    return [f"{key} = {_text(value)}" for key, value in table.items() if value is not None]


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list):
        return f"[{', '.join(map(_text, value))}]"
    return f"{{ {', '.join(_pairs(value))} }}" if isinstance(value, dict) else repr(value)
