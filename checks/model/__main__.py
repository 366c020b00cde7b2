"""`python -m checks.model`: explore, and print the figures and the counterexamples.

With `--document`, print docs/evidence/state-diagram.md instead.
"""

import sys
import time
from itertools import groupby

from checks.model.exploration import Exploration, document, endless, explore, parts


def main(arguments: list[str]) -> int:
    """Explore all parts, or print the document; return the exit code."""
    if arguments == ["--document"]:
        sys.stdout.write(document((part, explore(part.events)) for part in parts()))
        return 0
    wrong = 0
    for part in parts():
        began_s = time.process_time()
        found = explore(part.events)
        spent_s = time.process_time() - began_s
        states, edges = len(found.states), len(found.edges)
        print(f"{part.name}: {states} states, {edges} transitions, {spent_s:.1f} s")
        wrong += report(found)
    return 1 if wrong else 0


def report(found: Exploration) -> int:
    """Print the shortest counterexample of each rule, and the other events that break the rule."""
    violations = sorted(found.violations.values(), key=lambda one: (one.rule, len(one.events)))
    for _, group in groupby(violations, key=lambda one: one.rule):
        first, *others = group
        print(f"VIOLATED: {first}")
        if others:
            print(f"  also by: {', '.join(one.events[-1] for one in others)}")
    for state in endless(found):
        print(f"NO END of the goal in {state}\n  after: {', '.join(found.states[state])}")
    return len(violations) + len(endless(found))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
