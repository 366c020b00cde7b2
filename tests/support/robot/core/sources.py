"""Source files of the portable core."""

from pathlib import Path

CORE = Path(__file__).parents[4] / "robot" / "core"
FILES = sorted(CORE.rglob("*.py"))
