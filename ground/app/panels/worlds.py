"""Worlds as rows: their names and what they are, and the facts of one."""

from collections.abc import Mapping
from textwrap import wrap
from typing import Any, Final

from ground.app.panels.aged import number
from ground.app.widgets.rows import Row, Span, faint, head, row

REACHED: Final = "reached of 10 seeds: "


def world_row(world: Mapping[str, str], here: str, chosen: bool) -> Row:
    """The one that is in force has a mark."""
    mark = Span("● " if world["name"] == here else "  ", "ok")
    name = Span(f"{world['name']:<15}", "reverse" if chosen else "text")
    return row(" ", mark, name, f" {world['says']}")


def fact_rows(facts: Mapping[str, Any] | None, says: str) -> list[Row]:
    """What it is, how large, from where to where, and what goes wrong in it."""
    if facts is None:
        return [row(faint(" reading ..."))]
    width_m, height_m = facts["size_m"]
    start, goal = facts["start"], facts["goal"]
    moving = sum("path_m" in one for one in facts["obstacles"])
    faults = ", ".join(str(one["kind"]) for one in facts["faults"]) or "none"
    way_m = facts.get("shortest_path_m")
    heading_deg = goal.get("heading_deg")
    return [
        row(Span(f" {facts['name']}", "accent"), f"  {says}"),
        row(
            head(" size   "), f"{width_m:g} x {height_m:g} m, ",
            f"{len(facts['obstacles'])} obstacles, {moving} moving", head("  faults "), faults,
        ),
        row(
            head(" from   "), f"{start['x_m']:g} {start['y_m']:g} at {start['heading_deg']:g}°",
            head("  to "), f"{goal['x_m']:g} {goal['y_m']:g}",
            "" if heading_deg is None else f" at {heading_deg:g}°",
            head("  shortest way "), f"{number(way_m)} m" if way_m else "none",
        ),
    ]  # fmt: skip


def ends_rows(reached: Mapping[str, int] | None, width: int) -> list[Row]:
    """How runs of each navigator in this world have ended; nothing when that is not known."""
    if not reached:
        return []
    words = ", ".join(f"{navigator} {count}" for navigator, count in reached.items())
    first, *more = wrap(f"{REACHED}{words}", max(len(REACHED), width - 9))
    return [row(head(" study  "), first), *(row(f"        {line}") for line in more)]
