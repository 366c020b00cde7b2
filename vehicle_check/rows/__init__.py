"""The rows of the acceptance list, by theme."""

from importlib import import_module
from typing import Final

MODULES: Final = (
    "identity",
    "streams",
    "sensors",
    "requests",
    "parameter_rows",
    "mission_rows",
    "fences",
    "log_rows",
    "control_rows",
    "signing_rows",
    "robustness",
    "command_rows",
    "motion",
)
"""In the order of execution: rows that only receive first, rows that restart last."""


def load() -> None:
    """Import all modules, which adds their rows to the table."""
    for name in MODULES:
        import_module(f"{__name__}.{name}")
