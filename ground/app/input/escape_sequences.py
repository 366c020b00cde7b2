"""Split input into text and whole escape sequences (ECMA-48, and XTerm's own).

Textual's parser splits unknown sequences into letters, which would be keys of the app.
"""

import re
from collections.abc import Iterator
from typing import Final

ESCAPE: Final = "\x1b"
LONGEST: Final = 256
"""The most characters of an unfinished sequence; replies of terminals are shorter."""

_CSI: Final = r"\[[0-?]*[!-/]*"
_OPENS: Final = r"(?:\][0-9]|P[0-9!$+=>])"
_STRING: Final = rf"{_OPENS}[^\x07\x1b]*"
_KEY = re.compile(
    rf"{ESCAPE}(?:"
    r"\[\[[^\x1b]"  # Linux console
    r"|\[M[^\x1b]{3}"  # X10 mouse report
    r"|\[[0-9]+\$"  # rxvt
    rf"|{_CSI}[@-~]"
    r"|O[^\x1b]"
    rf"|{_STRING}(?:\x07|{ESCAPE}\\)"
    rf"|(?!{_OPENS})[^\x1b\[O])"
)
_BEGUN = re.compile(rf"{ESCAPE}(?:\[\[|\[M[^\x1b]{{0,2}}|{_CSI}|O|[\]P]|{_STRING}{ESCAPE}?)?\Z")
_BROKEN = re.compile(rf"{ESCAPE}(?:{_CSI}|O|{_STRING})?")
_TEXT = re.compile(r"[^\x1b]+")


def begun(text: str) -> int:
    """Return where an unfinished sequence begins at the end of the text, else its length."""
    found = _BEGUN.search(text)
    return len(text) if found is None or len(found[0]) > LONGEST else found.start()


def single(text: str) -> Iterator[str]:
    """Yield runs of characters, and escape sequences; of a broken one, the part there is."""
    at = 0
    while at < len(text):
        for pattern in (_TEXT, _KEY, _BROKEN):
            if found := pattern.match(text, at):
                yield found[0]
                at = found.end()
                break
