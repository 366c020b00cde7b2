"""`sidestep study`: run many trials, on all cores or a cluster, and report their results."""

import argparse
import importlib
import importlib.util
from collections.abc import Sequence
from typing import Final

from runtime.errors import UserError

NEEDED: Final = "pyarrow"
INSTALL: Final = "pip install 'sidestep[study]'"


def main(argv: Sequence[str]) -> int:
    """Return 0 when done, 1 with failed trials, 2 for wrong usage (argparse).

    Raises UserError for a configuration that cannot be used.
    """
    if importlib.util.find_spec(NEEDED) is None:
        raise UserError(f"{NEEDED} missing; {INSTALL}")
    if argv[:1] == ["report"]:
        code: int = importlib.import_module("study.cli.report").main(argv[1:])
        return code
    from study.cli.study_run import run  # imports NEEDED

    return run(argv)


def parser() -> argparse.ArgumentParser:
    """Return the parser of the verb."""
    from study.cli.study_run import parser as made  # imports NEEDED

    return made()
