"""`python -m benchmarks.lockstep.page --before FILE... --after FILE...`: compare two versions.

The files are outputs of `sidestep bench breakdown --json`. The page, docs/evidence/lockstep.md,
shows the medians of all repetitions in them.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any, Final

from verification.harness.figures import digits

INTRODUCTION: Final = """# A tick in lockstep

Where the time of a tick goes when plant, robot and ground run as three processes in lockstep over
Zenoh, before and after it was shortened. Each version was measured by

```sh
sidestep bench breakdown --json > FILE
```

in turn with the other one; `python -m benchmarks.lockstep.page --before FILE... --after FILE...`
wrote the page. The figures are medians of all repetitions, with minimum and maximum. The stages
follow one another and add up to the tick. The CPU times count all threads, also those that work
beside the stages. The note of a time costs about 0.3 us; there are about 30 in a tick.
"""

CAUSES: Final = """## What was changed

The gains are those of alternating runs of two versions, of the median tick unless another measure
is named.

- A thread of Zenoh keeps its Python state: 16 %. Python created and deleted a state for each
  callback, which maps and unmaps memory and so interrupts the other processor.
- One thread of Zenoh polls the sockets and receives: 4 %. Before, one woke another.
- Threads, saved replies and rejected frames are looked after behind the command: 10 %
  of the CPU time of robot and plant.
- In lockstep the receiving thread runs the control cycle: 8 to 14 %. Before, it woke the control
  thread.

All messages and rates are as before.

## What was tried and not kept

- A wake-up through an event descriptor instead of a lock: no difference.
- The scheduling class SCHED_BATCH: 15 % less CPU time, but a tick took more than twice as long
  beside busy processes.
- One thread that receives and sends: no gain, and a full queue could wait for itself.
- Plant and robot each on a processor of its own: 14 %, but then the scheduler has no choice.
- The plant's step in its receiving thread: 6 %. It needs a second structure of the plant's loop.
- Wheel ticks sent before the sonar is computed: no gain once the receiving thread runs the cycle.
- Faster encoding and decoding: they take 1 to 2 us per message with warm caches.

What is left above a trial and a bare round trip is mostly Python code with cold caches: core and
plant take almost twice as long as in a trial, and each hand-over to a sleeping thread takes 20 to
30 us.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.lockstep.page", description=__doc__)
    parser.add_argument("--before", type=Path, nargs="+", required=True)
    parser.add_argument("--after", type=Path, nargs="+", required=True)
    parser.add_argument("--output", type=Path, default=Path("docs/evidence/lockstep.md"))
    options = parser.parse_args(argv)
    before, after = merged(options.before), merged(options.after)
    text = "\n".join((INTRODUCTION, table(before, after), CAUSES))
    options.output.write_text(text, encoding="utf-8")
    return 0


def merged(files: Sequence[Path]) -> dict[str, Any]:
    """Return the first report with the values of all, and the machine of each."""
    reports: list[dict[str, Any]] = [json.loads(file.read_text("utf-8")) for file in files]
    found = reports[0]
    for figure, *others in zip(*(report["figures"] for report in reports), strict=True):
        for other in others:
            figure["values"] += other["values"]
    loads = [report["machine"]["load"] for report in reports]
    found["machine"]["load"] = ", ".join(loads)
    return found


def table(before: Mapping[str, Any], after: Mapping[str, Any]) -> str:
    """Return the figures of both reports side by side, with the machines."""
    former = {figure["name"]: figure for figure in before["figures"]}
    lines = ["| | before | after |", "|---|---|---|"]
    lines += [
        f"| {figure['name']} ({figure['unit']}) | {cell(former[figure['name']])} | {cell(figure)} |"
        for figure in after["figures"]
        if figure["name"] in former
    ]
    notes = [f"- {note}" for note in after["notes"]]
    for name, report in (("before", before), ("after", after)):
        machine = ", ".join(f"{key} {value}" for key, value in report["machine"].items())
        notes.append(f"- {name}: {machine}")
    return "\n".join([*lines, "", *notes, ""])


def cell(figure: Mapping[str, Any]) -> str:
    """Return the median of a figure, and its range."""
    values: list[float] = figure["values"]
    return f"{digits(median(values))} ({digits(min(values))} to {digits(max(values))})"


if __name__ == "__main__":
    raise SystemExit(main())
