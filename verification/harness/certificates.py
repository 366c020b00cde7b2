"""Certificates for runs with access control."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

VALID: Final = timedelta(days=1)


def made_keys(folder: Path, operators: Sequence[str] = ()) -> Path:
    """Create a folder of certificates for the robots r1 and r2, valid for a day, and return it."""
    # Imported here because other measurements run without its library.
    from ground.certificates.folder import make

    now = datetime.now(UTC)
    make(folder, ["r1", "r2"], {}, now - VALID, now + VALID, operators)
    return folder
