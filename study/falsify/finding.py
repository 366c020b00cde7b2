"""Findings as files: a world file whose first lines explain it and repeat its trial, and a picture.

The line that begins with `falsify:` has all that the trial needs besides the world. People may add
lines that begin with `found:`, the search that found it, and `fixed:`, the change that fixed it.
"""

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from plant.model.types import World
from plant.world.file import loads
from plant.world.writer import dumps
from runtime.errors import UserError
from runtime.regular_file import text_in
from runtime.toml_reader import MAX_BYTES
from study.falsify.evaluate import Subject, evaluate
from study.falsify.explain import sentence_of
from study.falsify.properties import Evaluation

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
        sentence=sentence_of(letter, subject.navigator, evaluation),
    )


def read(file: Path) -> Finding:
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
    from study.report.charts.drives import drive_trial
    from study.report.charts.world_map import WorldMap

    trial = trial_of(finding.subject, finding.world, finding.seed, finding.limit_s)
    drawn = WorldMap(finding.world, PICTURE_WIDTH, finding.sentence)
    drawn.straight()
    drawn.add(drive_trial(trial))
    drawn.ends()
    return drawn.drawing.alone()
