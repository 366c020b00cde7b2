"""Builds the documentation into build/site and checks it: `python -m checks.site`.

The build is strict: a warning fails it. The check then fails for a link that leads nowhere, a page
that no other page links to, and a script, style, font or picture from another host.
"""

import argparse
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from checks.site.links import problems

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
        print(f"{options.output}: open index.html, or run python -m http.server -d there")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
