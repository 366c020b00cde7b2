"""`python -m checks.site`: build the documentation into build/site and check it.

The build is strict: a warning fails it. The check then fails for a link that leads nowhere, a page
that no other page links to, and a script, style, font or picture from another host.
"""

import argparse
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from html.parser import HTMLParser
from pathlib import Path
from typing import Final, NamedTuple
from urllib.parse import unquote, urlsplit

HOME: Final = "index.html"
STANDALONE: Final = ("404.html",)
"""Pages that a server shows by itself; nothing links to them."""
LOADED: Final = {"script": "src", "img": "src", "iframe": "src", "source": "src", "object": "data"}
"""Elements that load a resource when the page is shown, and the attribute with its address."""
LOADING_RELATIONS: Final = {"stylesheet", "icon", "preload", "preconnect", "manifest", "prefetch"}


class Page(NamedTuple):
    """What the check needs of one HTML page."""

    anchors: frozenset[str]
    links: tuple[str, ...]
    loaded: tuple[str, ...]


class PageReader(HTMLParser):
    """Collects anchors, links and loaded resources of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.loaded: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Read one element."""
        given = {name: value or "" for name, value in attrs}
        self.anchors.update(given[name] for name in ("id", "name") if name in given)
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        elif tag == "link" and LOADING_RELATIONS & set(given.get("rel", "").split()):
            self.loaded.append(given.get("href", ""))
        elif tag in LOADED and LOADED[tag] in given:
            self.loaded.append(given[LOADED[tag]])


def read(path: Path) -> Page:
    """Parse one HTML file."""
    reader = PageReader()
    reader.feed(path.read_text(encoding="utf-8"))
    return Page(frozenset(reader.anchors), tuple(reader.links), tuple(reader.loaded))


def problems(site: Path) -> list[str]:
    """Return one line for each defect of the site below a folder, sorted."""
    pages = {path.relative_to(site).as_posix(): read(path) for path in site.rglob("*.html")}
    found = [
        f"{name}: {problem}"
        for name, page in pages.items()
        for problem in defects(site, name, pages)
    ]
    return sorted(found) + [f"{name}: no page links to it" for name in orphans(pages)]


def defects(site: Path, name: str, pages: dict[str, Page]) -> Iterator[str]:
    """Yield the dead links of a page, and the resources that it loads from other hosts."""
    for address in pages[name].loaded:
        parts = urlsplit(address)
        if parts.scheme == "data":
            continue
        if parts.netloc or parts.scheme:
            yield f"loads {address} from another host"
        elif not (site / target(name, parts.path)).is_file():
            yield f"loads {address}, which does not exist"
    for address in pages[name].links:
        parts = urlsplit(address)
        if parts.netloc or parts.scheme:
            continue
        goal = target(name, parts.path)
        if not (site / goal).is_file():
            yield f"links to {address}, which does not exist"
        elif parts.fragment and goal in pages:
            anchor = unquote(parts.fragment)
            if anchor not in pages[goal].anchors and anchor != "__top":
                yield f"links to {address}, but {goal} has no such anchor"


def target(page: str, path: str) -> str:
    """Return the file, relative to the site, that a path in a page leads to."""
    if not path:
        return page
    parts = [] if path.startswith("/") else page.split("/")[:-1]
    for part in unquote(path).lstrip("/").split("/"):
        if part == "..":
            parts = parts[:-1]
        elif part not in (".", ""):
            parts.append(part)
    return "/".join([*parts, HOME] if path.endswith("/") or not parts else parts)


def orphans(pages: dict[str, Page]) -> list[str]:
    """Return the pages that cannot be reached by links from the first page, sorted."""
    reached, waiting = {HOME}, [HOME]
    while waiting:
        page = waiting.pop()
        for address in pages[page].links if page in pages else ():
            parts = urlsplit(address)
            goal = target(page, parts.path)
            if not parts.netloc and not parts.scheme and goal in pages and goal not in reached:
                reached.add(goal)
                waiting.append(goal)
    return sorted(set(pages) - reached - set(STANDALONE))


ROOT: Final = Path(__file__).resolve().parents[2]
SITE: Final = ROOT / "build" / "site"


def build(site: Path) -> bool:
    """Run MkDocs in strict mode; return whether it succeeded."""
    words = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "--clean"]
    # The theme prints news about its future on each build.
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1", "PYTHONPATH": str(ROOT)}
    done = subprocess.run([*words, "--site-dir", str(site)], cwd=ROOT, env=environment, check=False)
    return done.returncode == 0


def main(argv: Sequence[str] | None = None) -> int:
    """Build and check; return 1 if a warning or a problem was found."""
    parser = argparse.ArgumentParser(prog="python -m checks.site", description=__doc__)
    parser.add_argument(
        "--output", type=Path, default=SITE, help="folder of the site (%(default)s)"
    )
    options = parser.parse_args(argv)
    if not build(options.output):
        return 1
    found = problems(options.output)
    for problem in found:
        print(problem, file=sys.stderr)
    if not found:
        print(f"{options.output}: open index.html")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
