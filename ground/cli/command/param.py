"""`param`: the robot's own list of parameters, one of them, or a new value for one."""

import argparse
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from fnmatch import fnmatchcase
from math import isclose, isfinite
from pathlib import Path
from types import MappingProxyType
from typing import Final

from ground.cli.command import param_files
from ground.client.connection import add_common
from ground.client.link import Link, Unanswered
from ground.client.parameter_rows import NAME_RULE, Row, rows_in
from ground.client.requests import is_saving
from ground.text.output import Says
from protocol.options import finite
from protocol.topics import PARAMETER, PARAMETERS
from protocol.wire.enums import PARAM_TYPE_REAL32
from protocol.wire.limits import MAX_PARAMETER_NAME_BYTES
from protocol.wire.messages import CommandAck, ParamSet, ParamValue
from protocol.wire.reasons import Reason, reason_text
from runtime.errors import RemoteError, UserError
from runtime.units import NS_PER_S

ATTEMPTS: Final = 3
PATIENCE_S: Final = 0.5
SAVING_NS: Final = 15_000_000_000
"""Longer than a robot waits for its disk before it answers NOT_SAVED."""

SAVED: Final[Mapping[bool | None, str]] = MappingProxyType(
    {
        True: "saved on the robot",
        False: "until the robot restarts: it runs without --state DIR and saves nothing",
        None: "in force; whether it is saved the robot does not say",
    }
)
COLUMNS: Final = ("name", "value", "unit", "minimum", "maximum", "default", "safer", "doc")
ALLOWED: Final[Mapping[object, str]] = MappingProxyType(
    {"up": ", no lower", "down": ", no higher", "near": ", within a tenth of that"}
)
"""Values of a safety parameter, by its direction."""


def arguments(parser: argparse.ArgumentParser) -> None:
    names = "list|get|diff|set|reset|save|load"
    actions = parser.add_subparsers(dest="action", required=True, metavar=names)
    listing = actions.add_parser("list", help="all of them, with unit, range, default and meaning")
    listing.add_argument("pattern", nargs="?", default="*", metavar="GLOB")
    getting = actions.add_parser("get", help="those whose name matches, as in 'sonar_*'")
    getting.add_argument("pattern", metavar="GLOB")
    setting = actions.add_parser("set", help="give one a value; a robot with --state saves it")
    setting.add_argument("name", metavar="NAME")
    setting.add_argument("value", type=finite, metavar="VALUE")
    resetting = actions.add_parser("reset", help="give one its default value")
    resetting.add_argument("name", metavar="NAME")
    saving = actions.add_parser("save", help="write what is not default; set saves on the robot")
    saving.add_argument(
        "file", nargs="?", type=Path, metavar="FILE", help="without it, say what the robot keeps"
    )
    loading = actions.add_parser("load", help="set all that a file says, if all of it can be")
    loading.add_argument("file", type=Path, metavar="FILE", help="TOML with [parameters]")
    differing = actions.add_parser("diff", help="those that are not as they are by default")
    for action in (listing, getting, setting, resetting, saving, loading, differing):
        add_common(action)


def act(options: argparse.Namespace, link: Link, says: Says) -> int:
    if options.action == "set":
        return change(link, says, options.name, options.value)
    rows = fetch(link)
    if options.action == "save":
        return tell_saved(says, rows) if options.file is None else save(says, rows, options.file)
    if options.action == "load":
        return load(link, says, rows, options.file)
    if options.action == "reset":
        return change(link, says, options.name, default_of(rows, options.name))
    if options.action == "diff":
        return show_changed(says, rows)
    return show(says, rows, options.pattern, wide=options.action == "list")


def fetch(link: Link) -> list[Row]:
    """The robot's list; Unanswered when it does not come, RemoteError when it cannot be read."""
    answer = ask(link, None)
    if not isinstance(answer, bytes):
        raise RemoteError("the robot answers, but not with a list of parameters")
    return rows_in(answer)


def show(says: Says, rows: Iterable[Row], pattern: str, *, wide: bool) -> int:
    chosen = [row for row in rows if fnmatchcase(str(row["name"]), pattern)]
    if not chosen:
        raise UserError(f"no parameter matches {pattern!r}: sidestep param list")
    text = table(chosen) if wide else "\n".join(line(row) for row in chosen)
    says.result({"parameters": chosen}, text)
    return 0


def show_changed(says: Says, rows: Iterable[Row]) -> int:
    chosen = [row for row in rows if not param_files.is_usual(row)]
    text = table(chosen) if chosen else "all are as they are by default"
    says.result({"parameters": chosen}, text)
    return 0


def default_of(rows: Iterable[Row], name: str) -> float:
    """UserError when the robot has no such parameter, or does not tell its default."""
    defaults = {str(row["name"]): row.get("default") for row in rows}
    value = defaults.get(name)
    if name not in defaults or not isinstance(value, int | float):
        near = get_close_matches(name, defaults, n=1)
        hint = f"did you mean {near[0]}?" if near else "sidestep param list"
        raise UserError(f"no parameter {name!r} with a default: {hint}")
    return float(value)


def save(says: Says, rows: list[Row], path: Path) -> int:
    names = param_files.write(path, rows)
    found: dict[str, object] = {"verb": "param save", "ok": True, "file": str(path)}
    text = f"{path}: {', '.join(names) or 'none is other than by default'}"
    says.result(found | {"saved": names}, text)
    return 0


def load(link: Link, says: Says, rows: list[Row], path: Path) -> int:
    """Nothing is set unless all can be; 1 when the robot refuses one all the same."""
    wanted = param_files.read(path, rows)
    values = {str(row["name"]): row["value"] for row in rows}
    done: list[str] = []
    refusal = ""
    for name, value in wanted.items():
        if param_files.same(float(str(values[name])), value):
            continue
        answer = ask(link, ParamSet(param_id=name, param_value=value, param_type=PARAM_TYPE_REAL32))
        if not isinstance(answer, ParamValue):
            reason = answer.result_param2 if isinstance(answer, CommandAck) else Reason.MALFORMED
            refusal = f"refused: {name} = {number(value)}: {reason_text(reason)}"
            break
        done.append(name)
    set_now = f"set: {', '.join(done)}" if done else "nothing was other than the file says"
    found: dict[str, object] = {"verb": "param load", "ok": not refusal, "set": done}
    says.result(found | {"reason": refusal}, f"{refusal}; {set_now}" if refusal else set_now)
    return 1 if refusal else 0


def tell_saved(says: Says, rows: Iterable[Row]) -> int:
    """There is nothing to do; what was set is saved or cannot be. 1 when nothing is."""
    names = [str(row["name"]) for row in rows if row.get("saved")]
    text = f"nothing to do: saved on the robot: {', '.join(names)}"
    if not names:
        text = "nothing is saved; a robot with --state DIR saves each value when it is set"
    says.result({"verb": "param save", "ok": bool(names), "saved": names}, text)
    return 0 if names else 1


def saved(link: Link, name: str) -> bool | None:
    """Whether the robot says that the value in force survives a restart; None: it does not say."""
    try:
        rows = fetch(link)
    except RemoteError:
        return None
    known = [row.get("saved") for row in rows if row["name"] == name]
    return known[0] if known and isinstance(known[0], bool) else None


def hint(link: Link, name: str, reason: int) -> str:
    """What the robot would have taken, by its own list; nothing when it does not tell."""
    try:
        rows = {str(row["name"]): row for row in fetch(link)}
    except RemoteError:
        return ""
    if reason == Reason.UNKNOWN_PARAMETER:
        near = get_close_matches(name, rows, n=1)
        return f"; did you mean {near[0]}?" if near else "; see sidestep param list"
    row = rows.get(name, {})
    if reason == Reason.LESS_SAFE_THAN_CONFIGURED and "configured" in row:
        configured = f"{number(row['configured'])} {row.get('unit', '')}".rstrip()
        return f"; configured: {configured}{ALLOWED.get(row.get('direction'), '')}"
    if reason != Reason.PARAMETER_OUT_OF_RANGE or not {"minimum", "maximum"} <= row.keys():
        return ""
    limits = f"{number(row['minimum'])} to {number(row['maximum'])} {row.get('unit', '')}"
    return f"; it takes {limits.rstrip()}"


def line(row: Row) -> str:
    unit = row.get("unit")
    return f"{row['name']} = {number(row['value'])}{f' {unit}' if unit else ''}"


def table(rows: list[Row]) -> str:
    """Columns as wide as they must be; a value that is not the default is marked."""
    cells = [list(COLUMNS)]
    for row in rows:
        mark = "" if row["value"] == row.get("default") else " *"
        shown = row | {"safer": row.get("direction", "")}
        cells.append([cell(shown.get(name, "")) for name in COLUMNS])
        cells[-1][1] += mark
    widths = [max(len(one[at]) for one in cells) for at in range(len(COLUMNS))]
    return "\n".join(
        "  ".join(text.ljust(width) for text, width in zip(one, widths, strict=True)).rstrip()
        for one in cells
    )


def cell(value: object) -> str:
    return value if isinstance(value, str) else number(value)


def number(value: object) -> str:
    return f"{value:.7g}" if isinstance(value, int | float) else str(value)


def change(link: Link, says: Says, name: str, value: float) -> int:
    """Set one; 0 when the robot now has it."""
    if not name or len(name) > MAX_PARAMETER_NAME_BYTES or not name.isascii():
        raise UserError(f"{name!r} cannot be a parameter: {NAME_RULE}")
    answer = ask(link, ParamSet(param_id=name, param_value=value, param_type=PARAM_TYPE_REAL32))
    found: dict[str, object] = {"verb": "param set", "robot": link.robot, "name": name}
    if isinstance(answer, ParamValue):
        now = answer.param_value
        taken = isfinite(now) and isclose(now, value, rel_tol=1e-6, abs_tol=1e-9)
        kept = saved(link, name)
        said = "ok" if taken else "another value is kept"
        found |= {"ok": taken, "value": now, "reason": said, "saved": kept}
        text = f"{name} = {number(now)}, {SAVED[kept]}" if taken else f"kept at {now:g}"
        says.result(found, text)
        return 0 if taken else 1
    reason = answer.result_param2 if isinstance(answer, CommandAck) else Reason.MALFORMED
    text = reason_text(reason) + hint(link, name, reason)
    found |= {"ok": False, "value": None, "reason": text}
    says.result(found, f"refused: {name} = {number(value)}: {text}")
    return 1


def ask(link: Link, request: ParamSet | None) -> object:
    """Setting the same value twice does no harm, so it is simply asked again.

    Also while the robot says that it is saving the value, which a slow disk may take long for.
    """
    said, left = "", ATTEMPTS
    until_ns = link.clock.now_ns() + SAVING_NS
    while left and link.clock.now_ns() < until_ns:
        asked_ns = link.clock.now_ns()
        try:
            service = PARAMETERS if request is None else PARAMETER
            answer = link.bus.ask(service, request, PATIENCE_S, robot=link.robot)
        except RemoteError as error:
            said, left = str(error), left - 1
            link.clock.sleep_until(asked_ns + round(PATIENCE_S * NS_PER_S))
            continue
        if not is_saving(answer):
            return answer
        said = "it is in force, and still being saved"
    raise Unanswered(f"{link.diagnosis()} ({said})")
