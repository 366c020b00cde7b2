"""Check of a built site: dead links, orphan pages and resources from other hosts."""

from pathlib import Path

import pytest

from checks.site.__main__ import problems, target
from tests.support.each import each

LINK = '<a href="{}">next</a>'


def site(folder: Path, **pages: str) -> Path:
    """Write pages into a folder; `index` is the first page."""
    for name, body in pages.items():
        path = folder / f"{name.replace('__', '/')}.html"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f'<html><body><h1 id="top">x</h1>{body}</body></html>')
    return folder


def test_whole_site_has_no_problems(tmp_path: Path) -> None:
    (tmp_path / "a.svg").write_text("<svg/>")
    home = '<img src="a.svg"><a href="https://zenoh.io">z</a>' + LINK.format("part/page.html#top")
    assert problems(site(tmp_path, index=home, part__page=LINK.format("../#top"))) == []


@pytest.mark.parametrize(
    ("body", "problem"),
    [
        (LINK.format("no.html"), "index.html: links to no.html, which does not exist"),
        (LINK.format("#no"), "index.html: links to #no, but index.html has no such anchor"),
        ('<img src="no.png">', "index.html: loads no.png, which does not exist"),
        (
            '<script src="https://cdn.example/x.js"></script>',
            "index.html: loads https://cdn.example/x.js from another host",
        ),
        (
            '<link rel="stylesheet" href="//fonts.example/x.css">',
            "index.html: loads //fonts.example/x.css from another host",
        ),
    ],
)
def test_defect_is_named(body: str, problem: str, tmp_path: Path) -> None:
    assert problems(site(tmp_path, index=body)) == [problem]


def test_page_without_links_to_it_is_an_orphan(tmp_path: Path) -> None:
    pages = {"index": LINK.format("a.html"), "a": "", "b": LINK.format("a.html")}
    assert problems(site(tmp_path, **pages)) == ["b.html: no page links to it"]


@each(
    ("path", "goal"),
    [
        ("", "a/b.html"),
        ("c.html", "a/c.html"),
        ("../c.html", "c.html"),
        ("./", "a/index.html"),
        ("..", "index.html"),
        ("/c/", "c/index.html"),
    ],
)
def test_relative_address_leads_to_its_file(path: str, goal: str) -> None:
    assert target("a/b.html", path) == goal
