"""`python -m study.people`: drive through crowds and print contacts beside the two baselines."""

import argparse
import sys
from collections.abc import Sequence

from plant.corpus import CROWD_FAMILIES, generate
from plant.model.noise import LEVELS
from study.people.comparison import Comparison, compare, table
from study.trial.trial import NAVIGATORS


def main(argv: Sequence[str]) -> int:
    """Print one row for each navigator and family."""
    options = parser().parse_args(argv)
    rows: list[Comparison] = []
    for family in options.family:
        worlds = [generate(family, index, options.seed) for index in range(options.worlds)]
        rows += [compare(worlds, family, name, options.noise) for name in options.navigator]
    print(table(rows))
    return 0


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    made = argparse.ArgumentParser(prog="python -m study.people", description=__doc__)
    families = (*CROWD_FAMILIES, "moving")
    made.add_argument("--family", nargs="+", choices=families, default=list(CROWD_FAMILIES))
    made.add_argument("--navigator", nargs="+", choices=NAVIGATORS, default=["vgm_memory"])
    made.add_argument("--noise", choices=LEVELS, default="default")
    made.add_argument("--worlds", type=int, default=100, help="worlds of each family")
    made.add_argument("--seed", type=int, default=1, help="of the worlds")
    return made


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
