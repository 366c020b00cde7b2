"""Findings as files: explained worlds with pictures, and the directory of their search.

The first lines of a world file explain the failure in one sentence and repeat its trial. The line
that begins with `falsify:` has all that the trial needs besides the world. People may add lines
that begin with `found:`, the search that found it, and `fixed:`, the change that fixed it.

After a change one drive is not enough: a rare failure may occur or not, depending on a millimetre
in the way of the robot. Many drives from starts near that of a finding show whether the failure
became rarer.

The progress of a search counts the climbs that are complete from the first on. A climb that was
lost by an end of the process is run again, with the same result.
"""

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from math import pi
from pathlib import Path
from typing import Any, Final

from plant.corpus.generate import measured
from plant.model.draws import Draws
from plant.world.file import loads
from plant.world.writer import dumps
from protocol.navigators import name_of
from protocol.wire.reasons import Reason, reason_text
from protocol.world import World
from robot.core import states
from runtime.errors import UserError
from runtime.files import text_in, value_in
from runtime.toml_reader import MAX_BYTES
from study.falsify.climb import SearchSettings
from study.falsify.evaluate import Subject, evaluate
from study.falsify.properties import ELLIPSE, ContactRecord, Evaluation, ratio_of
from study.runner.store import MAX_SETTINGS_BYTES, exclusive, replacing

BRANCHES = {
    states.TO_GOAL: "while it drives straight to the goal",
    states.PASS_LEFT: "while it passes an obstacle on the left",
    states.PASS_RIGHT: "while it passes an obstacle on the right",
    states.ALIGN: "while it turns to the final heading",
}


def sentence_of(letter: str, navigator: str, one: Evaluation) -> str:
    """Return a sentence on the violation of a property."""
    outcome = one.outcome
    spent = f"after {outcome.time_s:.0f} s and {outcome.path_m:.1f} m"
    shortest = outcome.shortest_path_m
    exists = "" if shortest is None else f"although a way of {shortest:.2f} m exists"
    if letter == "a":
        return f"{navigator} {_end(one)} {spent} {exists}{_driven(one)}."
    if letter == "b":
        return (
            f"{navigator} calls the goal unreachable {spent} {exists}{_claimed(one)}{_driven(one)}."
        )
    if letter == "c":
        place = BRANCHES.get(one.contact_branch, "while it stands or turns")
        return (
            f"{navigator} touches {_touched(one.contact)} by its own motion {place}, at the latest"
            f" {spent}{_echo(one.contact)}{_driven(one)}."
        )
    if letter == "d":
        return (
            f"The position error of {navigator} is {one.mahalanobis2**0.5:.1f} times the claimed"
            f" standard deviation (limit {ELLIPSE**0.5:.1f}) in a drive of {outcome.path_m:.1f} m."
        )
    if letter == "e":
        return (
            f"{navigator} arrives on a way of {outcome.path_m:.1f} m, {ratio_of(outcome):.1f} times"
            f" the shortest{_driven(one)}."
        )
    end = f"{_end(one)} {spent}, and has not recognised that there is no way"
    return f"{navigator} {end}{_driven(one)}."


def _end(one: Evaluation) -> str:
    if one.kind == "timeout-still":
        return "no longer moves and is out of time"
    if one.kind == "timeout-moving":
        return "still drives and is out of time"
    if one.outcome.reached:
        return "arrives"
    return f"ends ({reason_text(Reason(one.goal_reason)).partition(':')[0]})"


def _claimed(one: Evaluation) -> str:
    """Return the records behind a claim: the last lap, and the doubt about the position."""
    lap, doubt_m = one.lap, one.outcome.doubt_m
    found = []
    if lap is not None:
        gaps = f"{lap.gaps} gap{'' if lap.gaps == 1 else 's'}" if lap.gaps else "no gap"
        found.append(f"a lap of {lap.length_m:.1f} m with {gaps} in the chain of echoes")
    if doubt_m is not None:
        found.append(f"a position doubt of {doubt_m:.2f} m")
    return f", with {' and '.join(found)}" if found else ""


def _touched(contact: ContactRecord | None) -> str:
    """Return the touched thing and the speed of the contact."""
    if contact is None:
        return "something"
    return f"{contact.touched} at {contact.speed_m_s:.2f} m/s"


def _echo(contact: ContactRecord | None) -> str:
    """Return the last echo towards the touched thing."""
    if contact is None:
        return ""
    if not contact.is_in_view:
        return ", where no sonar points"
    if contact.range_m is None or contact.age_s is None:
        return ", when the sonar towards it had measured no echo"
    return (
        f", when the sonar towards it had last measured {contact.range_m:.2f} m,"
        f" {contact.age_s:.2f} s before"
    )


def _driven(one: Evaluation) -> str:
    """Return what was recorded of the decisions, as the end of a sentence."""
    return (
        f" (obstacles passed: {one.avoidances}, changes of side: {one.side_changes}, nearest to the"
        f" goal: {one.nearest_goal_m:.2f} m)"
    )


RECIPE: Final = re.compile(r"^# falsify: (.+)$", re.MULTILINE)
NOTE: Final = re.compile(r"^# (found|fixed): (.+)$", re.MULTILINE)
KEYS: Final = ("property", "navigator", "side", "noise", "seed", "limit_s", "detour", "kind")
PICTURE_WIDTH: Final = 420.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """A violated property, the trial that violates it, and a sentence that explains it."""

    letter: str
    subject: Subject
    world: World
    seed: int
    limit_s: float
    kind: str
    sentence: str
    found: str = ""
    fixed: str = ""

    def text(self) -> str:
        """Return the finding as the text of a world file."""
        subject = self.subject
        values = (
            *(self.letter, subject.navigator, subject.side, subject.noise, self.seed),
            *(f"{self.limit_s:g}", f"{subject.detour:g}", self.kind),
        )
        recipe = " ".join(f"{key}={value}" for key, value in zip(KEYS, values, strict=True))
        lines = [self.sentence, f"falsify: {recipe}"]
        lines += [f"found: {self.found}"] if self.found else []
        lines += [f"fixed: {self.fixed}"] if self.fixed else []
        return dumps(self.world, "\n".join(lines))

    def replay(self) -> Evaluation:
        """Run the trial again."""
        return evaluate(self.subject, self.world, self.seed, self.limit_s)


def finding_of(
    subject: Subject, letter: str, evaluation: Evaluation, limit_s: float, name: str
) -> Finding:
    """Return the finding of a shrunk evaluation."""
    world = replace(evaluation.world, name=name, noise={"level": subject.noise})
    return Finding(
        letter=letter,
        subject=subject,
        world=world,
        seed=evaluation.seed,
        limit_s=limit_s,
        kind=evaluation.kind,
        sentence=sentence_of(letter, name_of(subject.navigator), evaluation),
    )


def read_finding(file: Path) -> Finding:
    """Read a finding; raise UserError or WorldError for a file that is none."""
    try:
        text = text_in(file, MAX_BYTES)
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or error
        raise UserError(f"{file}: cannot be read: {why}; give a file of a finding") from None
    found = RECIPE.search(text)
    pairs = dict(pair.partition("=")[::2] for pair in found[1].split()) if found else {}
    try:
        side, noise, detour = pairs["side"], pairs["noise"], float(pairs["detour"])
        return Finding(
            letter=pairs["property"],
            subject=Subject(navigator=pairs["navigator"], side=side, noise=noise, detour=detour),
            world=loads(text, str(file)),
            seed=int(pairs["seed"]),
            limit_s=float(pairs["limit_s"]),
            kind=pairs["kind"],
            sentence=text.partition("\n")[0].removeprefix("# "),
            **dict(NOTE.findall(text)),
        )
    except (KeyError, ValueError) as error:
        if isinstance(error, UserError):
            raise
        raise UserError(
            f"{file}: is no finding: its line '# falsify: {' '.join(KEYS)}' is missing or damaged"
            f" ({error}); give a file that `sidestep falsify` wrote"
        ) from None


def picture(finding: Finding) -> str:
    """Return the world with the drive in it as SVG."""
    from study.falsify.evaluate import trial_of  # slow imports: drawing
    from study.report.drives import drive_trial
    from study.report.world_map import WorldMap

    trial = trial_of(finding.subject, finding.world, finding.seed, finding.limit_s)
    drawn = WorldMap(finding.world, PICTURE_WIDTH, finding.sentence)
    drawn.straight()
    drawn.add(drive_trial(trial))
    drawn.ends()
    return drawn.drawing.alone()


MAX_SHIFT_M: Final = 0.03
MAX_TURN_RAD: Final = 6.0 * pi / 180.0
"""Most that a start differs from the finding's: along each axis, and in heading."""
MAX_DRAWS: Final = 20
"""Draws of one start; those without room are discarded."""


def near(finding: Finding, count: int) -> Iterator[Finding]:
    """Yield the finding from `count` other starts, with seeds counted up from its own.

    Equal findings yield equal drives.

    Raises UserError if almost no start near it has room.
    """
    for number in range(count):
        random = Draws(f"{finding.world.name}/{number}")
        tries = (_moved(finding.world, random) for _ in range(MAX_DRAWS))
        world = next((one for one in tries if one is not None), None)
        if world is None:
            raise UserError(f"{finding.world.name}: no room near its start; leave out --starts")
        yield replace(finding, world=world, seed=finding.seed + number)


def violates(finding: Finding) -> bool:
    """Run the trial and return whether it violates the finding's property."""
    return finding.letter in finding.replay().violated


def _moved(world: World, random: Draws) -> World | None:
    """Return the world with another start, or None if the robot has no room there."""
    start = world.start
    moved = replace(
        start,
        x_m=start.x_m + random.uniform(-MAX_SHIFT_M, MAX_SHIFT_M),
        y_m=start.y_m + random.uniform(-MAX_SHIFT_M, MAX_SHIFT_M),
        heading_rad=start.heading_rad + random.uniform(-MAX_TURN_RAD, MAX_TURN_RAD),
    )
    tried = measured(replace(world, start=moved))
    return None if tried is None or tried.reachable != world.reachable else tried


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
def open_search(directory: Path, wanted: Mapping[str, Any]) -> Iterator[SearchProgress]:
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


def save_progress(directory: Path, progress: SearchProgress) -> None:
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
        stored = value_in(text_in(file, MAX_SETTINGS_BYTES))
    except (OSError, ValueError) as error:
        raise UserError(f"{file}: cannot be read: {error}; remove it to search again") from None
    if not isinstance(stored, dict):
        raise UserError(f"{file}: is no JSON object; remove it to search again")
    return stored


def _write(file: Path, values: Mapping[str, Any]) -> None:
    with replacing(file) as opened_file:
        opened_file.write(json.dumps(values, indent=1).encode())
