"""`sidestep study`: many trials, on all cores or a cluster, and what they come to."""

import importlib
import importlib.util
import sys
from collections.abc import Sequence
from typing import Final

from runtime.errors import UserError

NEEDED: Final = "pyarrow"
INSTALL: Final = "pip install 'sidestep[study]'"


def main(argv: Sequence[str] | None = None) -> int:
    """0 done, 1 with failed trials, 2 wrong usage (argparse) or configuration (raised)."""
    verb, *rest = sys.argv[1:] if argv is None else argv
    assert verb == "study"
    if importlib.util.find_spec(NEEDED) is None:
        raise UserError(f"{NEEDED} missing; {INSTALL}")
    if rest[:1] == ["report"]:
        code: int = importlib.import_module("study.report.cli").main(rest[1:])
        return code
    from study.cli.study_run import run  # needs what was looked for above

    return run(rest)
