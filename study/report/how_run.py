"""Description of the run of a study: trials, code and machine, so that a reader can repeat it."""

from collections.abc import Mapping
from math import isfinite
from typing import Final

import numpy as np

from study.report.page import Block, CodeBlock, PageTable, Paragraph
from study.report.trials import Trials
from study.report.words import count, number
from study.runner.rows import FAILED
from study.trial.trial import ALL_NAVIGATORS

SHOWN: Final = 6


def how_run(trials: Trials, kept: int, command: str) -> tuple[Block, ...]:
    """Describe all rows, of which `kept` are distinct drives."""
    lead = Paragraph(
        f"{count(len(trials))} trials in {count(len(set(trials.texts('world_digest').tolist())))} "
        f"worlds of {len(trials.values('family'))} families, "
        f"{number(_sum(trials, 'time_s') / 3600.0, 1)} simulated hours in "
        f"{number(_sum(trials, 'cpu_s') / 3600.0, 2)} hours of processor time."
    )
    rows = tuple((name, text) for name, text in _facts(trials, kept).items())
    caption = "Trials, code and machine."
    table = PageTable(caption, ("", ""), rows, names=2)
    return (lead, CodeBlock(command), table) if command else (lead, table)


def _facts(trials: Trials, kept: int) -> Mapping[str, str]:
    facts = {
        "study": _all(trials, "study"),
        "navigators": "; ".join(trials.labels()),
        "noise": _all(trials, "noise"),
        "seeds": _seeds(trials),
        "parameters": _all(trials, "parameters"),
        "calibrated": _flag(trials, "calibrated"),
        "code": f"commit {_commits(trials)}; uncommitted changes: {_flag(trials, 'dirty')}",
        "version": _all(trials, "version"),
        "Python": _all(trials, "python"),
        "numpy, pymunk": f"{_all(trials, 'numpy')}, {_all(trials, 'pymunk')}",
        "platform": _all(trials, "platform"),
        "processor": _all(trials, "machine"),
        "run": _times(trials),
    }
    if kept != len(trials):
        facts["repetitions"] = (
            f"{count(len(trials) - kept)} trials are bit-identical to another one, as all seeds "
            "are without noise; each drive is counted once"
        )
    failed = trials.count(trials.has(outcome=FAILED))
    if failed:
        facts["failed"] = f"{count(failed)} trials could not be run; none counts as a success"
    strange = [name for name in trials.values("navigator") if name not in ALL_NAVIGATORS]
    if strange:
        facts["unknown here"] = ", ".join(strange)
    return facts


def _sum(trials: Trials, name: str) -> float:
    return float(np.nansum(trials.numbers(name)))


def _all(trials: Trials, name: str) -> str:
    found = [value for value in trials.values(name) if value]
    more = f" and {len(found) - SHOWN} more" if len(found) > SHOWN else ""
    return ", ".join(found[:SHOWN]) + more or "-"


def _commits(trials: Trials) -> str:
    return ", ".join(commit[:12] for commit in trials.values("commit")[:SHOWN] if commit) or "-"


def _flag(trials: Trials, name: str) -> str:
    words = {0.0: "no", 1.0: "yes"}
    found = sorted({words[value] for value in trials.numbers(name).tolist() if isfinite(value)})
    return " and ".join(found) or "-"


def _seeds(trials: Trials) -> str:
    found = sorted({int(seed) for seed in trials.numbers("seed").tolist() if isfinite(seed)})
    if found == list(range(len(found))) and len(found) > 1:
        return f"0 to {len(found) - 1}"
    return ", ".join(map(str, found[:SHOWN])) + (" …" if len(found) > SHOWN else "") or "-"


def _times(trials: Trials) -> str:
    found = [time for time in trials.values("started_utc") if time]
    return f"{found[0]} to {found[-1]} (UTC)" if found else "-"
