"""The command line in the app: the grammar of the shell, parsed into typed operations."""

from ground.console.app_commands import LOCAL, AppCommand
from ground.console.completion import complete
from ground.console.help import help_text
from ground.console.history import History
from ground.console.parser import read, verbs
from ground.console.spelling import line_of

__all__ = [
    "LOCAL",
    "AppCommand",
    "History",
    "complete",
    "help_text",
    "line_of",
    "read",
    "verbs",
]
