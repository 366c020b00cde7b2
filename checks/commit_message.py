"""Checks the form of a commit message: `area: imperative subject`, 72 columns, then the reason.

The hook `.githooks/commit-msg` calls this with the file of the message. It refuses a wrong form; a
subject that does not seem to begin with an imperative is only advice. It imports nothing of the
project, so that it also works without `make setup`.
"""

import re
import sys
from pathlib import Path

MAX_COLUMNS = 72
SUBJECT = re.compile(r"[A-Za-z0-9_.,/ -]+: \S.*[^.\s]")
GENERATED = ("Merge ", "Revert ", "fixup! ", "squash! ", "amend! ")
NO_IMPERATIVE = re.compile(r"(\w+ed|\w+ing|fixes|adds|removes|changes|updates|renames)\b")
IMPERATIVES = (
    *("bring", "embed", "exceed", "feed", "need", "ring", "seed", "shed", "speed"),
    "string",
)


def problems(message: str) -> list[str]:
    """Return one line for each defect of a message; comments of git do not count."""
    text = message.partition("\n# ------------------------ >8")[0]
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    while lines and not lines[-1].strip():
        lines.pop()
    if not lines:
        return ["the message is empty: write `area: imperative subject`"]
    subject, *body = lines
    if subject.startswith(GENERATED):
        return []
    found = []
    if not SUBJECT.fullmatch(subject):
        found.append("line 1: write `area: imperative subject`, without a full stop")
    if len(subject) > MAX_COLUMNS:
        found.append(f"line 1: {len(subject)} characters: use at most {MAX_COLUMNS}")
    if body and body[0].strip():
        found.append("line 2: leave it empty")
    found += [
        f"line {number}: {len(line)} columns: use at most {MAX_COLUMNS}"
        for number, line in enumerate(body, 2)
        if len(line) > MAX_COLUMNS and " " in line.strip()
    ]
    return found


def advice(message: str) -> list[str]:
    """Return a line if the subject begins with another form of a verb, such as "added"."""
    subject = message.partition("\n")[0]
    verb = subject.partition(": ")[2].partition(" ")[0].lower()
    if subject.startswith(GENERATED) or verb in IMPERATIVES or not NO_IMPERATIVE.fullmatch(verb):
        return []
    return [f"{verb!r} may be no imperative: write what the commit does"]


def main(argv: list[str]) -> int:
    """Print defects and advice for the message in a file; 1 if there are defects."""
    message = Path(argv[0]).read_text(encoding="utf-8")
    found = problems(message)
    for line in found:
        print(f"commit message: {line}", file=sys.stderr)
    for line in advice(message):
        print(f"commit message: advice: {line}", file=sys.stderr)
    if found:
        print("see CONTRIBUTING.md, Commits", file=sys.stderr)
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
