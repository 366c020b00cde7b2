"""The command line inside of the app: one grammar and one code path with the shell's."""

from ground.console.app_commands import LOCAL, Local
from ground.console.completion import complete
from ground.console.help import help_text
from ground.console.history import History
from ground.console.parser import parse, verbs
from ground.console.run_command import Word, act, act_locally

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
