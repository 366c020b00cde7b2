"""`sidestep study`: many trials, on all cores or a cluster, and what they come to."""

import importlib
import importlib.util
from collections.abc import Sequence
from typing import Final

from runtime.errors import UserError

NEEDED: Final = "pyarrow"
INSTALL: Final = "pip install 'sidestep[study]'"


def main(argv: Sequence[str]) -> int:
    """0 done, 1 with failed trials, 2 wrong usage (argparse) or configuration (raised)."""
    if importlib.util.find_spec(NEEDED) is None:
        raise UserError(f"{NEEDED} missing; {INSTALL}")
    if argv[:1] == ["report"]:
        code: int = importlib.import_module("study.report.cli").main(argv[1:])
        return code
    from study.cli.study_run import run  # needs what was looked for above

    return run(argv)
