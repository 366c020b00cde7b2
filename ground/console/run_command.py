"""Does what was typed over the link that is there: the code of the command line, no other."""

import argparse
from collections.abc import Callable, Mapping
from typing import Final

from ground.cli.verbs import VERBS
from ground.client.link import Link
from ground.console.help import help_text
from ground.missions.draft import Draft
from ground.missions.files import DASH
from ground.text.output import Says
from runtime.errors import RemoteError, UserError

EXIT_NOT: Final = 1
EXIT_USAGE: Final = 2


Word = Callable[[argparse.Namespace, Says], int]


def act(options: argparse.Namespace, link: Link, says: Says, draft: Draft | None = None) -> int:
    """The exit code the command line would have ended with; errors are said, not raised.

    `draft` is what `mission upload -` sends, where a shell would have standard input.
    """

    def done() -> int:
        drafted = getattr(options, "file", None) == DASH
        options.typed = (draft or Draft()).text if drafted else None
        verb = VERBS[options.verb]
        return verb.run(options, says) if verb.act is None else verb.act(options, link, says)

    return _said(options.verb, says, done)


def act_locally(options: argparse.Namespace, says: Says, words: Mapping[str, Word]) -> int:
    """The same for what needs no robot: help is the console's own, the rest are the app's words."""

    def done() -> int:
        if options.verb == "help":
            says.result({"help": options.word}, help_text(options.word))
            return 0
        if options.verb not in words:
            raise UserError("is not there on this screen")
        return words[options.verb](options, says)

    return _said(options.verb, says, done)


def _said(verb: str, says: Says, done: Callable[[], int]) -> int:
    try:
        return done()
    except UserError as error:
        says.note(f"{verb}: {error}")
        return EXIT_USAGE
    except RemoteError as error:
        says.note(f"{verb}: {error}")
        return int(getattr(error, "exit_code", EXIT_NOT))
