"""The command line inside of the app: one grammar and one code path with the shell's."""

from ground.console.acting import Word, act, act_locally
from ground.console.completion import complete
from ground.console.helping import help_text
from ground.console.history import History
from ground.console.local import LOCAL, Local
from ground.console.reading import parse, verbs

__all__ = [
    "LOCAL",
    "History",
    "Local",
    "Word",
    "act",
    "act_locally",
    "complete",
    "help_text",
    "parse",
    "verbs",
]
