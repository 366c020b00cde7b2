"""Arguments of the verbs that read the state of a robot or a recording."""

import argparse
from typing import Final

from ground.client.operations import Operation
from ground.client.results import Outcome
from ground.grammar.words import LONGEST_S, Words, add_common, add_json, seconds
from ground.reports.doctor import LISTEN_S, Diagnose
from ground.reports.explain import ExplainNow, ExplainRecording
from ground.reports.export import Export
from ground.reports.figure.style import SCREEN, STYLES
from ground.reports.plot import Plot
from ground.reports.share import Share
from ground.reports.snapshot import LookOnce
from protocol.options import finite, up_to
from runtime.errors import UserError

moment: Final = up_to(LONGEST_S)


class WatchWords(Words):
    """The arguments of `watch`."""

    once: bool

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        add_common(parser)
        help = "print the state once, as --json does"
        parser.add_argument("--once", action="store_true", help=help)

    def operation(self) -> LookOnce:
        """Return the operation for the parsed arguments."""
        return LookOnce()


class DoctorWords(Words):
    """The arguments of `doctor`."""

    timeout: float

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        add_common(parser)
        help = f"listen for this time ({LISTEN_S:g})"
        parser.add_argument("--timeout", type=seconds, default=LISTEN_S, metavar="S", help=help)

    def operation(self) -> Diagnose:
        """Return the operation for the parsed arguments."""
        return Diagnose(listen_s=self.timeout)


class ExplainWords(Words):
    """The arguments of `explain`."""

    file: str | None
    at: float | None
    turns: bool

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        help = "a recording; else the robot, now"
        parser.add_argument("file", nargs="?", metavar="FILE", help=help)
        help = "seconds of the recording (the last turning point)"
        parser.add_argument("--at", type=moment, metavar="S", help=help)
        parser.add_argument("--turns", action="store_true", help="list its turning points")
        add_common(parser)

    def operation(self) -> Operation[Outcome]:
        """Return the operation for the parsed arguments."""
        if self.file is not None:
            return ExplainRecording(file=self.file, at_s=self.at, turns=self.turns, robot=self.id)
        if self.at is not None or self.turns:
            raise UserError("--at and --turns need a recording: name its FILE")
        return ExplainNow()


class ExportWords(Words):
    """The arguments of `export`."""

    file: str
    format: str
    shape: str
    rate: float | None
    begin: float | None
    end: float | None
    out: str | None

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        parser.add_argument("file", metavar="FILE", help="a .tlog or .mcap")
        parser.add_argument("--format", choices=("csv", "parquet"), default="csv", help="(csv)")
        help = "a row per value that came, or per instant of a grid (long)"
        parser.add_argument("--shape", choices=("long", "wide"), default="long", help=help)
        help = "instants of wide: the last value not older than its stale-after, else empty (20)"
        parser.add_argument("--rate", type=finite, metavar="HZ", help=help)
        help = "begin at this second of the robot's stamps"
        parser.add_argument("--from", dest="begin", type=finite, metavar="S", help=help)
        parser.add_argument("--to", dest="end", type=finite, metavar="S", help="end there")
        parser.add_argument("--out", metavar="FILE", help="write here, not to standard output")
        add_json(parser)

    def operation(self) -> Export:
        """Return the operation for the parsed arguments."""
        if self.json and self.out is None:
            raise UserError("--json and the table cannot both use standard output: add --out FILE")
        return Export(
            file=self.file,
            format=self.format,
            shape=self.shape,
            rate_hz=self.rate,
            begin_s=self.begin,
            end_s=self.end,
            out=self.out,
        )


class PlotWords(Words):
    """The arguments of `plot`."""

    file: str
    out: str
    world: str | None
    begin: float | None
    end: float | None
    style: str

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        parser.add_argument("file", metavar="FILE", help="a .tlog or .mcap")
        help = "a .png, .svg or .pdf (FILE.png)"
        parser.add_argument("--out", default="", metavar="FILE", help=help)
        help = f"for the screen, or one column of a paper ({SCREEN.name})"
        parser.add_argument("--style", choices=list(STYLES), default=SCREEN.name, help=help)
        help = "the world of the run; an .mcap contains it"
        parser.add_argument("--world", metavar="W", help=help)
        help = "begin at this second of the robot's stamps"
        parser.add_argument("--from", dest="begin", type=finite, metavar="S", help=help)
        parser.add_argument("--to", dest="end", type=finite, metavar="S", help="end there")
        add_json(parser)

    def operation(self) -> Plot:
        """Return the operation for the parsed arguments."""
        return Plot(
            file=self.file,
            out=self.out,
            world=self.world,
            begin_s=self.begin,
            end_s=self.end,
            style=self.style,
        )


class ShareWords(Words):
    """The arguments of `share`."""

    file: str
    out: str

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        parser.add_argument("file", metavar="FILE", help="a .tlog or .mcap")
        help = "a .zip (FILE.zip)"
        parser.add_argument("--out", default="", metavar="FILE", help=help)
        add_json(parser)

    def operation(self) -> Share:
        """Return the operation for the parsed arguments."""
        return Share(file=self.file, out=self.out)
