"""Do what the words of a verb mean, and print what came of it."""

from ground.cli.observe.live_line import follow
from ground.cli.options import common_of
from ground.client.link import UnansweredError, open_link
from ground.client.operations import Session
from ground.client.results import Outcome
from ground.grammar.looking import WatchWords
from ground.grammar.words import FromFile, Offline, Words
from ground.reports.doctor import Diagnose
from ground.reports.export import Exported
from ground.text.output import Output


def run(words: Words, says: Output) -> int:
    """Return 0 when it succeeded, 1 when not. Values are refused before a robot is dialled."""
    if isinstance(words, WatchWords) and not (words.once or words.json):
        return follow(common_of(words))
    operation = words.operation()
    if isinstance(operation, Offline):
        return tell(says, words, "", operation.run(says))
    if isinstance(operation, FromFile):
        operation = operation.read()
    common = common_of(words)
    try:
        with open_link(common) as link:
            return tell(says, words, link.robot, operation.perform(Session(link, says)))
    except UnansweredError as error:
        if not isinstance(operation, Diagnose):
            raise
        return tell(says, words, common.robot, operation.undialled(error, common.endpoint))


def tell(says: Output, words: Words, robot: str, outcome: Outcome) -> int:
    """Print the outcome; a table on standard output is the result already."""
    if isinstance(outcome, Exported) and outcome.out is None:
        says.note(outcome.text)
    else:
        says.result(outcome.as_json(words.title, robot), outcome.text)
    return 0 if outcome.ok else 1
