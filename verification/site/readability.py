"""Measures how easy pages are to read: the grade of Flesch and Kincaid.

    0.39 * words / sentences + 11.8 * syllables / words - 15.59

Kincaid et al. 1975. Only running text counts: code, tables, headings and comments are left out, a
name in code counts as a short word, and each item of a list is a sentence.
`python -m verification.site.readability` prints the grade of each page of the tutorial and guides.
"""

import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import median
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[2]
MAX_GRADE: Final = 10.0
"""Of the median page of the tutorial and the guides."""
GUIDES: Final = ("tutorial", "how-to")
LEFT_OUT: Final = re.compile(
    r"^( *)```.*?^\1```$|^---\n.*?^---$|<!--.*?-->|^ *!\[.*?$|^ *=== .*?$|^ *\|.*?$|^#.*?$",
    re.MULTILINE | re.DOTALL,
)
LINK: Final = re.compile(r"\[([^\]]*)\]\([^)]*\)")
CODE: Final = re.compile(r"`[^`]*`|\+\+[^ ]*\+\+")
ITEM: Final = re.compile(r"^\s*(?:[-*]|\d+\.)\s+", re.MULTILINE)
SENTENCE: Final = re.compile(r"[.!?](?=\s|$)|:?\n\s*\n")
WORD: Final = re.compile(r"[A-Za-z][A-Za-z'-]*|\d[\d.,]*")
VOWELS: Final = re.compile(r"[aeiouy]+")


def grade(page: str) -> float:
    """Return the grade of a page in Markdown; 0 for a page without text."""
    sentences = list(sentences_of(page))
    words = [word for sentence in sentences for word in sentence]
    if not words:
        return 0.0
    per_sentence = len(words) / len(sentences)
    return 0.39 * per_sentence + 11.8 * sum(map(syllables, words)) / len(words) - 15.59


def sentences_of(page: str) -> Iterator[list[str]]:
    """Yield the words of each sentence."""
    text = LEFT_OUT.sub("", page)
    text = CODE.sub("it", LINK.sub(r"\1", text))
    text = ITEM.sub("\n\n", text)
    for part in SENTENCE.split(text):
        words = WORD.findall(part)
        if words:
            yield words


def syllables(word: str) -> int:
    """Count the syllables of an English word, by its groups of vowels."""
    plain = re.sub(r"[^a-z]", "", word.lower())
    if not plain:
        return 1
    count = len(VOWELS.findall(plain))
    is_silent = plain.endswith("e") and not re.search(r"[^aeiouy]le$", plain)
    if is_silent or re.search(r"[^td]ed$", plain):
        count -= 1
    return max(1, count)


def grades(docs: Path) -> dict[str, float]:
    """Return the grade of each page of the tutorial and the guides."""
    return {
        path.relative_to(docs).as_posix(): grade(path.read_text(encoding="utf-8"))
        for folder in GUIDES
        for path in sorted((docs / folder).glob("*.md"))
    }


def main(argv: Sequence[str] | None = None) -> int:
    """Print the grades; 1 if the median is above the limit."""
    found = grades(ROOT / "docs")
    for name, value in found.items():
        print(f"{value:5.1f}  {name}")
    print(f"{median(found.values()):5.1f}  median, at most {MAX_GRADE:g}")
    return int(median(found.values()) > MAX_GRADE)


if __name__ == "__main__":
    sys.exit(main())
