"""Certificates for runs behind locked doors."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

VALID: Final = timedelta(days=1)


def made_keys(folder: Path, operators: Sequence[str] = ()) -> Path:
    """Make a set of certificates of this run's own, for two robots, and return its folder."""
    from ground.certificates.folder import (
        make,  # its library need not be there for other measurements
    )

    now = datetime.now(UTC)
    make(folder, ["r1", "r2"], {}, now - VALID, now + VALID, operators)
    return folder
