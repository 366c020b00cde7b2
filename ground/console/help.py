"""The command `help`: all commands in a line each, or one command with its arguments."""

from ground.console.app_commands import LOCAL
from ground.console.parser import ALIASES, COMMANDS, expanded, parser_for, usage_of
from runtime.cli.verb_table import command_of


def help_text(word: str = "") -> str:
    """Return the help; UserError if there is no such command."""
    if word:
        return f"{_with_usage(word)}"
    short = {name: " ".join(words) for name, words in ALIASES.items() if name.isalpha()}
    lines = [f"{name:<12} {text}" for name, text in summaries().items()]
    lines.append("short: " + ", ".join(f"{name} = {long}" for name, long in short.items()))
    return "\n".join(lines)


def summaries() -> dict[str, str]:
    """Return the summary of every command."""
    rows = {command_of(name): command.summary for name, command in COMMANDS.items()}
    return rows | {name: local.summary for name, local in LOCAL.items()}


def _with_usage(word: str) -> str:
    words = expanded([word])
    parser = parser_for(words)
    rest = parser.format_help().split("\n\n", 1)[-1].strip()
    return f"{usage_of(parser)}\n{rest}"
