"""Worlds as rows: their names and what they are, and the facts of one."""

from collections.abc import Mapping
from typing import Any

from ground.app.faces.aged import number
from ground.widgets.rows import Row, Span, faint, head, row


def world_row(world: Mapping[str, str], here: str, chosen: bool) -> Row:
    """The one that is in force has a mark."""
    mark = Span("● " if world["name"] == here else "  ", "ok")
    return row(
        " ",
        mark,
        Span(f"{world['name']:<15}", "reverse" if chosen else "text"),
        f" {world['says']}",
    )


def fact_rows(facts: Mapping[str, Any] | None) -> list[Row]:
    if facts is None:
        return [row(faint(" reading ...")), (), ()]
    width_m, height_m = facts["size_m"]
    start, goal = facts["start"], facts["goal"]
    moving = sum("path_m" in one for one in facts["obstacles"])
    faults = ", ".join(str(one["kind"]) for one in facts["faults"]) or "none"
    way_m = facts.get("shortest_path_m")
    return [
        row(
            Span(f" {facts['name']}", "accent"),
            f"  {width_m:g} x {height_m:g} m, {len(facts['obstacles'])} obstacles, {moving} moving",
        ),
        row(
            head(" from "), f"{start['x_m']:g} {start['y_m']:g} at {start['heading_deg']:g}°",
            head("  to "), f"{goal['x_m']:g} {goal['y_m']:g}",
            head("  shortest way "), f"{number(way_m)} m" if way_m else "none",
        ),
        row(head(" faults "), faults),
    ]  # fmt: skip
