"""The directory of a search: its settings, its progress, and its findings.

The progress counts the climbs that are complete from the first on. A climb that was lost by an end
of the process is run again, with the same result.
"""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

from runtime.errors import UserError
from runtime.json_reader import value_in
from runtime.regular_file import text_in
from study.falsify.climb import SearchSettings
from study.falsify.finding import Finding
from study.runner.store import replacing
from study.runner.study_settings import MAX_BYTES, exclusive

SETTINGS: Final = "search.json"
PROGRESS: Final = "progress.json"
INDEX: Final = "findings.md"


@dataclass(slots=True)
class ClassRecord:
    """A class of failure: the climb that found it first, how often it was seen, and its finding.

    `sentence` is empty until the finding has been shrunk and written, which was when the search had
    used `after_s` seconds.
    """

    climb: int
    seen: int = 1
    walls: int = 0
    sentence: str = ""
    after_s: float = 0.0


@dataclass(slots=True)
class SearchProgress:
    """Progress of a search: sums over all its calls, and the classes of failure."""

    climbs: int = 0
    trials: int = 0
    simulated_s: float = 0.0
    spent_s: float = 0.0
    classes: dict[str, ClassRecord] = field(default_factory=dict)


def settings_json(settings: SearchSettings, code: str) -> dict[str, Any]:
    """Return the settings that determine a search, as stored."""
    values = asdict(settings)
    subject = values.pop("subject")
    listed = {
        key: list(value) if isinstance(value, tuple) else value for key, value in values.items()
    }
    return {**subject, **listed, "code": code}


@contextmanager
def opened(directory: Path, wanted: Mapping[str, Any]) -> Iterator[SearchProgress]:
    """Lock the directory and yield the progress stored there.

    Raises UserError when the directory cannot be written, or belongs to another search.
    """
    with exclusive(directory):
        stored = _read(directory / SETTINGS)
        if stored is None and any(one.name != "lock" for one in directory.iterdir()):
            raise UserError(
                f"--output {directory}: is not empty and holds no search; give another directory"
            )
        if stored is not None and stored != wanted:
            changed = sorted(key for key in wanted if stored.get(key) != wanted[key])
            raise UserError(
                f"--output {directory}: holds another search ({', '.join(changed)} differ);"
                " give another directory"
            )
        if stored is None:
            _write(directory / SETTINGS, dict(wanted))
        yield _progress_in(directory / PROGRESS)


def save(directory: Path, progress: SearchProgress) -> None:
    """Store the progress."""
    _write(directory / PROGRESS, asdict(progress))


def save_finding(directory: Path, finding: Finding, drawn: str) -> None:
    """Write the world file and the picture of a finding."""
    for suffix, text in ((".svg", drawn), (".toml", finding.text())):
        with replacing(directory / f"{finding.world.name}{suffix}") as file:
            file.write(text.encode())


def save_index(directory: Path, progress: SearchProgress) -> None:
    """Write the list of findings, most frequent class first."""
    rows = sorted(progress.classes.items(), key=lambda one: (-one[1].seen, one[0]))
    lines = [
        f"# Findings in {progress.trials} trials",
        "",
        "| class | seen | walls | small after | failure |",
        "|---|---:|---:|---:|---|",
    ]
    for name, one in rows:
        shown = f"[{name}]({name}.toml)" if one.sentence else name
        after = f"{one.after_s:.0f} s" if one.sentence else ""
        sentence = one.sentence or "not shrunk"
        lines.append(f"| {shown} | {one.seen} | {one.walls} | {after} | {sentence} |")
    with replacing(directory / INDEX) as file:
        file.write(("\n".join(lines) + "\n").encode())


def _progress_in(file: Path) -> SearchProgress:
    stored = _read(file)
    if stored is None:
        return SearchProgress()
    try:
        classes = {name: ClassRecord(**one) for name, one in stored.pop("classes").items()}
        return SearchProgress(**stored, classes=classes)
    except (KeyError, TypeError, AttributeError) as error:
        raise UserError(f"{file}: is damaged ({error}); remove it to search again") from None


def _read(file: Path) -> dict[str, Any] | None:
    if not file.exists():
        return None
    try:
        stored = value_in(text_in(file, MAX_BYTES))
    except (OSError, ValueError) as error:
        raise UserError(f"{file}: cannot be read: {error}; remove it to search again") from None
    if not isinstance(stored, dict):
        raise UserError(f"{file}: is no JSON object; remove it to search again")
    return stored


def _write(file: Path, values: Mapping[str, Any]) -> None:
    with replacing(file) as opened_file:
        opened_file.write(json.dumps(values, indent=1).encode())
