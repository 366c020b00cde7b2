"""What a study's directory was made with, so that nothing else is mixed into it unnoticed."""

import fcntl
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from runtime.errors import UserError
from runtime.json_reader import value_in
from study.runner.plan import StudySettings
from study.runner.provenance import CodeVersion, MachineInfo
from study.runner.sources import ListedWorld
from study.runner.store import replacing

FILE: Final = "settings.json"
LOCK: Final = "lock"
MAX_NAMED: Final = 3


def settings_of(
    worlds: Sequence[ListedWorld], settings: StudySettings, code: CodeVersion, machine: MachineInfo
) -> dict[str, Any]:
    """As it is stored; of the machine only the libraries that may round differently."""
    return {
        "navigators": list(settings.navigators),
        "noise": list(settings.noise),
        "seeds": settings.seeds,
        "timeout_s": settings.timeout_s,
        "parameters": dict(settings.parameters),
        "calibrated": settings.calibrated,
        "worlds": {one.world.name: one.digest for one in worlds},
        "version": code.version,
        "code": code.digest,
        "numpy": machine.numpy,
        "pymunk": machine.pymunk,
    }


def settle(
    directory: Path, wanted: Mapping[str, Any], code: CodeVersion, *, mixed: bool
) -> list[str]:
    """Write the settings down; what differs from those that are there, when that is allowed.

    Raises UserError, naming what differs, when it is not.
    """
    file = directory / FILE
    there = told_in(file)
    differing = [] if there is None else differences(there, wanted)
    if differing and not mixed:
        raise UserError(
            f"{directory}: holds a study made otherwise: {'; '.join(differing)}; choose another "
            "--output, or go on in this one with --mixed"
        )
    if there is None or differing:
        with replacing(file) as opened:
            opened.write(json.dumps({**wanted, "commit": code.commit}, indent=1).encode())
    return differing


def differences(there: Mapping[str, Any], wanted: Mapping[str, Any]) -> list[str]:
    """Each in a few words; the commit is told where the code differs."""
    found = []
    for key, value in wanted.items():
        before = there.get(key)
        if before == value:
            continue
        if key == "worlds":
            found.append(_worlds(before if isinstance(before, dict) else {}, value))
        elif key == "code":
            found.append(f"other code (it was made at commit {there.get('commit', 'unknown')})")
        else:
            found.append(f"{key} was {_short(before)}, is {_short(value)}")
    return found


def _worlds(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    names = sorted(name for name in {*before, *now} if before.get(name) != now.get(name))
    more = f" and {len(names) - MAX_NAMED} more" if len(names) > MAX_NAMED else ""
    return f"{len(before)} worlds were, {len(now)} are ({', '.join(names[:MAX_NAMED])}{more})"


def _short(value: object) -> str:
    return " ".join(map(str, value)) if isinstance(value, list) else json.dumps(value)


def told_in(file: Path) -> dict[str, Any] | None:
    """What the file holds; None when it is not there. Raises UserError when it cannot be read."""
    if not file.exists():
        return None
    try:
        there = value_in(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UserError(
            f"{file}: cannot be read: {error}; remove it, and the settings given now are taken "
            "for those the study was made with"
        ) from None
    if not isinstance(there, dict):
        raise UserError(f"{file}: is not a JSON object; remove it")
    return there


@contextmanager
def alone(directory: Path) -> Iterator[None]:
    """Nobody else writes into this study meanwhile; who is killed holds it no longer."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
        opened = (directory / LOCK).open("wb")
    except OSError as error:
        raise UserError(f"--output {directory}: {error.strerror}; give another place") from None
    with opened:
        try:
            fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UserError(
                f"{directory}: another study writes there; wait for it, or give another --output"
            ) from None
        yield
