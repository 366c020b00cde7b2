"""Hooks of MkDocs, named in mkdocs.yml: generated tables, pictures of screens and of findings."""

import re
from pathlib import Path
from typing import Final

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from checks.site.reference import GENERATORS

ROOT: Final = Path(__file__).resolve().parents[2]
SCREENS: Final = ROOT / "tests" / "tui" / "snapshots"
FINDINGS: Final = ROOT / "study" / "falsify" / "worlds"
GENERATED: Final = re.compile(r"^<!-- generated: (?P<name>[a-z-]+) -->$", re.MULTILINE)
FONT: Final = re.compile(r"@font-face \{.*?\}\s*", re.DOTALL)
"""The pictures ask for a font from another host; the site uses fonts of the system."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pictures of the screens and of the findings, which tests keep up to date."""
    for path in sorted(SCREENS.glob("*.svg")):
        picture = FONT.sub("", path.read_text(encoding="utf-8"))
        name = f"pictures/screens/{path.name}"
        files.append(File.generated(config, name, content=picture))
    for path in sorted(FINDINGS.glob("*/*.svg")):
        name = f"pictures/findings/{path.parent.name}/{path.name}"
        files.append(File.generated(config, name, content=path.read_text(encoding="utf-8")))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Replace the comments that ask for a generated table."""
    return GENERATED.sub(lambda found: GENERATORS[found["name"]](), markdown)
