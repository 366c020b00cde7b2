"""Measures how plain the English of the project is: `python -m verification.language [PATH ...]`.

Three habits make text hard to read for an engineer who is not a native speaker: a process or a
message is called a person, software does what only people do, and a docstring begins with a
relative clause instead of a verb. The share of texts with each habit is counted over docstrings,
comments, messages, test names and documentation. `MAX_SHARE` is the limit that the tests hold.
"""

import argparse
import ast
import io
import re
import subprocess
import sys
import tokenize
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple
from xml.etree import ElementTree

ROOT: Final = Path(__file__).resolve().parents[1]
MAX_SHARE: Final = 0.01
"""Of the texts of one kind, for each pattern."""
MIN_WORDS: Final = 3
"""A string literal with fewer words is a key or a name, not a message."""

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
    source = path.read_text()
    if path.suffix == ".py":
        nodes = list(ast.walk(ast.parse(source)))
        yield from docstrings(nodes, path)
        if "tests" not in path.parts:
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


def files(paths: Sequence[Path]) -> list[Path]:
    """Return the files of the project below `paths` that git knows and that hold texts."""
    words = [
        "git",
        "ls-files",
        "--cached",
        "--others",
        "--exclude-standard",
        "--",
        *map(str, paths),
    ]
    listed = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return [
        ROOT / name
        for name in listed.splitlines()
        if name.endswith((".py", ".md", "sidestep.xml")) and (ROOT / name).exists()
    ]


def measured(texts: Iterable[Text]) -> tuple[Counter[str], dict[tuple[str, str], list[Text]]]:
    """Return the number of texts of each kind, and the texts that have each habit."""
    count: Counter[str] = Counter()
    found: dict[tuple[str, str], list[Text]] = {
        (kind, habit): [] for kind in KINDS for habit in HABITS
    }
    for text in texts:
        count[text.kind] += 1
        for habit in habits(text):
            found[text.kind, habit].append(text)
    return count, found


def main(argv: Sequence[str] | None = None) -> int:
    """Print the shares, and with --list each place; 1 when a share exceeds the limit."""
    parser = argparse.ArgumentParser(prog="python -m verification.language", description=__doc__)
    parser.add_argument("paths", nargs="*", type=Path, default=[ROOT], help="(the whole project)")
    parser.add_argument("--list", action="store_true", help="print each text with a habit")
    options = parser.parse_args(argv)
    count, found = measured(text for path in files(options.paths) for text in texts_of(path))
    if options.list:
        for (_, habit), texts in found.items():
            for text in texts:
                place = f"{text.path.relative_to(ROOT)}:{text.line}"
                print(f"{place}: {text.kind}: {habit}: {text.words.splitlines()[0][:100]}")
    print(f"{'':10}" + "".join(f"{habit:>12}" for habit in HABITS) + f"{'of':>8}")
    for kind in KINDS:
        shares = (len(found[kind, habit]) / max(1, count[kind]) for habit in HABITS)
        print(f"{kind:10}" + "".join(f"{share:12.1%}" for share in shares) + f"{count[kind]:8}")
    limit = {key: MAX_SHARE * count[key[0]] for key in found}
    return int(any(len(texts) > limit[key] for key, texts in found.items()))


if __name__ == "__main__":
    sys.exit(main())
