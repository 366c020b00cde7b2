"""The stored settings of a study, which prevent mixing different studies in one directory."""

import fcntl
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from runtime.errors import UserError
from runtime.json_reader import value_in
from runtime.regular_file import text_in
from study.runner.plan import StudySettings
from study.runner.provenance import CodeVersion, MachineInfo
from study.runner.sources import ListedWorld
from study.runner.store import replacing

FILE: Final = "settings.json"
LOCK: Final = "lock"
MAX_NAMED: Final = 3
MAX_BYTES: Final = 1 << 26


def settings_of(
    worlds: Sequence[ListedWorld], settings: StudySettings, code: CodeVersion, machine: MachineInfo
) -> dict[str, Any]:
    """Return the settings as stored; of the machine only libraries that may round differently."""
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


def check_settings(
    directory: Path, wanted: Mapping[str, Any], code: CodeVersion, *, mixed: bool
) -> list[str]:
    """Store the settings; return the differences from those stored before, if `mixed` allows them.

    Raises UserError, naming the differences, if it does not.
    """
    file = directory / FILE
    stored = settings_in(file)
    differing = [] if stored is None else differences(stored, wanted)
    if differing and not mixed:
        raise UserError(
            f"{directory}: holds a study with other settings: {'; '.join(differing)}; choose "
            "another --output, or continue in this one with --mixed"
        )
    if stored is None or differing:
        with replacing(file) as opened:
            opened.write(json.dumps({**wanted, "commit": code.commit}, indent=1).encode())
    return differing


def differences(stored: Mapping[str, Any], wanted: Mapping[str, Any]) -> list[str]:
    """Return each difference in a few words, with the commit where the code differs."""
    found = []
    for key, value in wanted.items():
        before = stored.get(key)
        if before == value:
            continue
        if key == "worlds":
            found.append(_worlds(before if isinstance(before, dict) else {}, value))
        elif key == "code":
            found.append(f"other code (it was made at commit {stored.get('commit', 'unknown')})")
        else:
            found.append(f"{key} was {_short(before)}, is {_short(value)}")
    return found


def _worlds(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    names = sorted(name for name in {*before, *now} if before.get(name) != now.get(name))
    more = f" and {len(names) - MAX_NAMED} more" if len(names) > MAX_NAMED else ""
    return f"{len(before)} worlds were, {len(now)} are ({', '.join(names[:MAX_NAMED])}{more})"


def _short(value: object) -> str:
    return " ".join(map(str, value)) if isinstance(value, list) else json.dumps(value)


def settings_in(file: Path) -> dict[str, Any] | None:
    """Return the settings in a file; None without the file.

    Raises UserError when it cannot be read.
    """
    if not file.exists():
        return None
    try:
        stored = value_in(text_in(file, MAX_BYTES))
    except (OSError, ValueError) as error:
        raise UserError(
            f"{file}: cannot be read: {error}; remove it if the study was made with the settings "
            "given now"
        ) from None
    if not isinstance(stored, dict):
        raise UserError(f"{file}: is not a JSON object; remove it")
    return stored


@contextmanager
def exclusive(directory: Path) -> Iterator[None]:
    """Lock the study's directory; the lock ends with the process, also when killed.

    Raises UserError when another study holds it or it cannot be made.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
        opened = (directory / LOCK).open("wb")
    except OSError as error:
        raise UserError(f"--output {directory}: {error.strerror}; choose another") from None
    with opened:
        try:
            fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UserError(
                f"{directory}: another study is writing there; wait for its end, or give another "
                "--output"
            ) from None
        yield
