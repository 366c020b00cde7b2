"""Suggest where the English of the project could be plainer: `make prose`, `ARGS="docs/how-to"`.

Habits make text hard to read for an engineer who is not a native speaker: a process or a message is
called a person, software does what only people do, a docstring begins with a relative clause or
another form of a verb instead of an imperative, and a page has long words in long sentences. Each
text with such a habit is printed with its place, then the share of these texts, by kind. It is
advice: a reader is the judge, no check depends on it, and the exit code is 0.

The reading grade of a page is that of Flesch and Kincaid (Kincaid et al. 1975):

    0.39 * words / sentences + 11.8 * syllables / words - 15.59

Only running text counts: code, tables, headings and comments are left out, a name in code counts as
a short word, and each item of a list is a sentence.
"""

import argparse
import ast
import io
import json
import re
import subprocess
import sys
import tokenize
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from statistics import median
from typing import Final, NamedTuple
from xml.etree import ElementTree

ROOT: Final = Path(__file__).resolve().parents[1]
MIN_WORDS: Final = 3
"""A string literal with fewer words is a key or a name, not a message."""
EASY_GRADE: Final = 10.0
"""A page above this reading grade is suggested for simpler sentences."""

PERSON: Final = re.compile(
    r"\b(who|whom|whoever|whomever|somebody|someone|nobody|anybody|anyone|everybody|he|him|his)\b",
    re.IGNORECASE,
)
HUMAN_VERB: Final = re.compile(
    r"\b(tells?|told|telling|hears?|heard|hearing|stands?|stood|says?|said|saying|speaks?|spoken)\b",
    re.IGNORECASE,
)
RELATIVE: Final = re.compile(
    r"(what|whatever|whether|who|whom|whoever|whose|where|wherever|when|whenever|how|of|so|as|that"
    r"|which|whichever|if|while|until|since|because|though|although|nothing|nobody|those|it|its"
    r"|they|their|them|he|none|not|no)\b",
    re.IGNORECASE,
)
NO_VERB: Final = re.compile(
    r"(a|an|the|this|these|all|both|each|every|one|two|for|by|from|in|on|to|with|without|at|after"
    r"|before|between|true|false|\d)\b",
    re.IGNORECASE,
)
HABITS: Final = ("person", "human verb", "opening")
KINDS: Final = ("docstring", "comment", "message", "test name", "page", "dialect")

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

Function = ast.FunctionDef | ast.AsyncFunctionDef


class Text(NamedTuple):
    """A piece of English, and the place where it is written."""

    kind: str
    path: Path
    line: int
    words: str
    is_function: bool = False


def habits(text: Text) -> Iterator[str]:
    """Yield the habits that a text has; openings count in docstrings only."""
    if PERSON.search(text.words):
        yield "person"
    if HUMAN_VERB.search(text.words):
        yield "human verb"
    if text.kind == "docstring" and (
        RELATIVE.match(text.words) or (text.is_function and NO_VERB.match(text.words))
    ):
        yield "opening"


def texts_of(path: Path) -> Iterator[Text]:
    """Yield the texts of a Python module, a page in Markdown, or a MAVLink dialect."""
    source = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        nodes = list(ast.walk(ast.parse(source)))
        yield from docstrings(nodes, path)
        if "tests" not in shown(path).parts:
            yield from messages(nodes, path)
        if "#" in source:
            yield from comments(source, path)
    elif path.suffix == ".md":
        yield from sentences(source, path)
    elif path.suffix == ".xml":
        for element in ElementTree.fromstring(source).iter():
            if element.tag in ("description", "field", "param") and element.text:
                yield Text("dialect", path, 1, " ".join(element.text.split()))


def docstrings(nodes: Sequence[ast.AST], path: Path) -> Iterator[Text]:
    """Yield docstrings and test names."""
    for node in nodes:
        if isinstance(node, Function) and node.name.startswith("test_"):
            yield Text("test name", path, node.lineno, node.name.replace("_", " "))
        if isinstance(node, Function | ast.ClassDef | ast.Module):
            words = ast.get_docstring(node)
            if words:
                line = node.body[0].lineno
                yield Text("docstring", path, line, words, is_function=is_plain_function(node))


def is_plain_function(node: ast.AST) -> bool:
    """Return whether a node is a function whose docstring begins with a verb: no property."""
    return isinstance(node, Function) and not any(
        "property" in ast.unparse(decorator) for decorator in node.decorator_list
    )


def messages(nodes: Sequence[ast.AST], path: Path) -> Iterator[Text]:
    """Yield string literals that are sentences, f-strings with `_` for each value."""
    alone = {node.value for node in nodes if isinstance(node, ast.Expr)}
    parts = {part for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in nodes:
        if node in alone or node in parts:
            continue
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            words = node.value
        elif isinstance(node, ast.JoinedStr):
            words = "".join(
                str(part.value) if isinstance(part, ast.Constant) else "_" for part in node.values
            )
        else:
            continue
        if len(words.split()) >= MIN_WORDS:
            yield Text("message", path, node.lineno, words)


def comments(source: str, path: Path) -> Iterator[Text]:
    """Yield the comments that are not for a tool."""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT and not token.string.startswith(
            ("#!", "# type:", "# noqa")
        ):
            yield Text("comment", path, token.start[0], token.string.lstrip("# "))


def sentences(source: str, path: Path) -> Iterator[Text]:
    """Yield the sentences of a page without its blocks of code."""
    is_code = False
    for number, line in enumerate(source.splitlines(), 1):
        if line.lstrip().startswith("```"):
            is_code = not is_code
        elif not is_code:
            for sentence in re.split(r"(?<=[.!?:])\s+", re.sub(r"`[^`]*`", "`_`", line.strip())):
                if len(sentence.split()) >= MIN_WORDS:
                    yield Text("page", path, number, sentence)


def grade(page: str) -> float:
    """Return the reading grade of a page in Markdown; 0 for a page without text."""
    read = list(running_text(page))
    words = [word for sentence in read for word in sentence]
    if not words:
        return 0.0
    return 0.39 * len(words) / len(read) + 11.8 * sum(map(syllables, words)) / len(words) - 15.59


def running_text(page: str) -> Iterator[list[str]]:
    """Yield the words of each sentence that is read: no code, table, heading or comment."""
    text = CODE.sub("it", LINK.sub(r"\1", LEFT_OUT.sub("", page)))
    for part in SENTENCE.split(ITEM.sub("\n\n", text)):
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


def other_verb_forms(paths: Sequence[Path]) -> Iterator[str]:
    """Yield docstrings of the product that begin with "Returns" or the like, as ruff finds them."""
    words = (sys.executable, "-m", "ruff", "check", "--select", "D401", "--exit-zero", "--quiet")
    modules = [str(path) for path in paths if path.suffix == ".py"]
    if not modules:
        return
    done = subprocess.run(
        (*words, "--output-format", "json", *modules), cwd=ROOT, capture_output=True, check=False
    )
    for found in json.loads(done.stdout or "[]"):
        place = f"{shown(Path(found['filename']))}:{found['location']['row']}"
        yield f"{place}: docstring: verb: {found['message']}"


def files(paths: Iterable[Path]) -> list[Path]:
    """Return the named files, and those with texts that git knows below the named folders."""
    found: list[Path] = []
    for path in paths:
        if path.is_file():
            found.append(path)
            continue
        words = ("git", "ls-files", "--cached", "--others", "--exclude-standard")
        done = subprocess.run(words, cwd=path, capture_output=True, text=True, check=True)
        found += [path / name for name in sorted(set(done.stdout.splitlines()))]
    return [
        path
        for path in found
        if path.name.endswith((".py", ".md", "sidestep.xml")) and path.is_file()
    ]


def shown(path: Path) -> Path:
    """Return a path as it is printed: within the checkout, or as it is."""
    absolute = path.resolve()
    return absolute.relative_to(ROOT) if absolute.is_relative_to(ROOT) else path


def print_shares(count: Counter[str], found: Counter[tuple[str, str]]) -> None:
    """Print the share of texts with each habit, and the number of texts, of each kind."""
    print(f"\n{'':10}" + "".join(f"{habit:>12}" for habit in HABITS) + f"{'of':>8}")
    for kind in filter(count.get, KINDS):
        shares = (found[kind, habit] / count[kind] for habit in HABITS)
        print(f"{kind:10}" + "".join(f"{share:12.1%}" for share in shares) + f"{count[kind]:8}")


def main(argv: Sequence[str] | None = None) -> int:
    """Print a line for each suggestion, then the shares and reading grades; return 0."""
    parser = argparse.ArgumentParser(prog="make prose", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("paths", nargs="*", type=Path, default=[ROOT], help="(the whole project)")
    given: list[Path] = parser.parse_args(argv).paths
    for path in given:
        if not path.exists():
            print(f"{path}: no such file or folder")
    read = files(path for path in given if path.exists())
    count: Counter[str] = Counter()
    found: Counter[tuple[str, str]] = Counter()
    grades: dict[Path, float] = {}
    for path in read:
        try:
            texts = list(texts_of(path))
        except (OSError, SyntaxError, UnicodeDecodeError, tokenize.TokenError) as error:
            print(f"{shown(path)}: not read: {error}")
            continue
        for text in texts:
            count[text.kind] += 1
            for habit in habits(text):
                found[text.kind, habit] += 1
                line = text.words.splitlines()[0][:100]
                print(f"{shown(path)}:{text.line}: {text.kind}: {habit}: {line}")
        if path.suffix == ".md":
            grades[path] = grade(path.read_text(encoding="utf-8"))
            if grades[path] > EASY_GRADE:
                print(
                    f"{shown(path)}: page: reading grade {grades[path]:.1f}, easy: {EASY_GRADE:g}"
                )
    for suggestion in other_verb_forms(read):
        print(suggestion)
    print_shares(count, found)
    if grades:
        hardest = max(grades, key=lambda path: grades[path])
        print(
            f"\nreading grade of {len(grades)} pages: {median(grades.values()):.1f} in the median, "
            f"{grades[hardest]:.1f} of {shown(hardest)}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
