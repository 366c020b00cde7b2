"""Processes as the kernel lists them, and what a run has recorded."""

from pathlib import Path

from ground.recording.log_reader import TlogReader
from protocol.wire.codec import decode


def alive(pid: int) -> bool:
    """Is it there and not merely waiting to be reaped?"""
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"


ROOT = Path(__file__).parents[3]


def children_of(pid: int) -> list[int]:
    return [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def cmdline(pid: int) -> str:
    return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()


def frames_in(folder: Path) -> int:
    (log,) = folder.glob("*.tlog")
    with log.open("rb") as source:
        reader = TlogReader(source)
        for record in reader:
            decode(record.frame)
    assert reader.lost_bytes < 300, "more than the record that was being written is lost"
    return reader.records
