"""`python -m benchmarks.lockstep.page BEFORE AFTER`: write docs/evidence/lockstep.md.

BEFORE and AFTER are outputs of `sidestep bench breakdown --json` of two versions. The page compares
their medians.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from verification.harness.figures import digits

INTRODUCTION: Final = """# A tick in lockstep

Where the time of a tick goes when plant, robot and ground run as three processes in lockstep over
Zenoh, before and after it was shortened. Each version was measured by

```sh
sidestep bench breakdown --repetitions 7 --json > FILE
```

and the page was written by `python -m benchmarks.lockstep.page BEFORE AFTER`. The figures are
medians of the repetitions, with minimum and maximum. The stages follow one another and add up to
the tick. The CPU times count all threads, also those that work beside the stages. The note of a
time costs about 0.3 us; there are about 30 in a tick.
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
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("--output", type=Path, default=Path("docs/evidence/lockstep.md"))
    options = parser.parse_args(argv)
    before, after = (
        json.loads(file.read_text("utf-8")) for file in (options.before, options.after)
    )
    text = "\n".join((INTRODUCTION, table(before, after), CAUSES))
    options.output.write_text(text, encoding="utf-8")
    return 0


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
    low, high = digits(figure["minimum"]), digits(figure["maximum"])
    return f"{digits(figure['median'])} ({low} to {high})"


if __name__ == "__main__":
    raise SystemExit(main())
