"""Arguments of the verbs that read a recording."""

import argparse

from ground.client.outcomes import Outcome
from ground.client.session import Operation
from ground.commands.command import add_common, add_json
from ground.commands.explain import ExplainNow, ExplainRecording
from ground.commands.export import Export
from ground.commands.plot import Plot
from ground.commands.recordings import ListRecordings
from ground.commands.share import Share
from ground.grammar.looking import moment
from ground.grammar.words import Words
from ground.recording.catalogue import FILE_HELP, recording_named, recordings_in, remark_on
from ground.recording.figure import SCREEN, STYLES
from ground.user.folders import recordings_folder
from protocol.options import finite
from runtime.errors import UserError


class RecordingWords(Words):
    """The arguments of a verb that reads a recording; by default the newest finished one."""

    file: str | None

    @staticmethod
    def declare_file(parser: argparse.ArgumentParser) -> None:
        """Declare FILE."""
        parser.add_argument("file", nargs="?", metavar="FILE", help=FILE_HELP)

    def recording(self) -> str:
        """Return the path of the recording; UserError if there is none."""
        path = recording_named(self.file)
        self.chosen = remark_on(path, self.file)
        return str(path)


class ExplainWords(RecordingWords):
    """The arguments of `explain`."""

    at: float | None
    turns: bool

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        help = "a recording, as for replay; without --at and --turns the robot, now"
        parser.add_argument("file", nargs="?", metavar="FILE", help=help)
        help = "seconds of the recording (default the last turning point)"
        parser.add_argument("--at", type=moment, metavar="S", help=help)
        parser.add_argument("--turns", action="store_true", help="list its turning points")
        add_common(parser)

    def operation(self) -> Operation[Outcome]:
        """Return the operation for the parsed arguments."""
        if self.file is None and self.at is None and not self.turns:
            return ExplainNow()
        return self.from_recording()

    def from_recording(self) -> ExplainRecording:
        """Return the operation on a recording, by default the newest."""
        return ExplainRecording(
            file=self.recording(), at_s=self.at, turns=self.turns, robot=self.id
        )

    def without_robot(self) -> ExplainRecording | None:
        """Return the operation for the case that no robot was named and none answers."""
        named = (self.file, self.connect, self.config, self.run, self.id)
        if any(word is not None for word in named) or not recordings_in(recordings_folder()):
            return None
        return self.from_recording()


class ExportWords(RecordingWords):
    """The arguments of `export`."""

    format: str
    shape: str
    rate: float | None
    begin: float | None
    end: float | None
    out: str | None

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        cls.declare_file(parser)
        parser.add_argument(
            "--format", choices=("csv", "parquet"), default="csv", help="(default csv)"
        )
        help = "a row per value that came, or per instant of a grid (default long)"
        parser.add_argument("--shape", choices=("long", "wide"), default="long", help=help)
        help = "instants of wide: the last value unless it is stale, else empty (default 20)"
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
            file=self.recording(),
            format=self.format,
            shape=self.shape,
            rate_hz=self.rate,
            begin_s=self.begin,
            end_s=self.end,
            out=self.out,
        )


class PlotWords(RecordingWords):
    """The arguments of `plot`."""

    out: str
    world: str | None
    begin: float | None
    end: float | None
    style: str

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        cls.declare_file(parser)
        help = "a .png, .svg or .pdf (default FILE.png)"
        parser.add_argument("--out", default="", metavar="FILE", help=help)
        help = f"for the screen, or one column of a paper (default {SCREEN.name})"
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
            file=self.recording(),
            out=self.out,
            world=self.world,
            begin_s=self.begin,
            end_s=self.end,
            style=self.style,
        )


class ShareWords(RecordingWords):
    """The arguments of `share`."""

    out: str

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        cls.declare_file(parser)
        help = "a .zip (default FILE.zip)"
        parser.add_argument("--out", default="", metavar="FILE", help=help)
        add_json(parser)

    def operation(self) -> Share:
        """Return the operation for the parsed arguments."""
        return Share(file=self.recording(), out=self.out)


class ListWords(Words):
    """The arguments of `rec list`."""

    folder: str | None

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare the arguments."""
        help = f"their folder (default {recordings_folder()})"
        parser.add_argument("folder", nargs="?", metavar="DIR", help=help)
        add_json(parser)

    def operation(self) -> ListRecordings:
        """Return the operation for the parsed arguments."""
        return ListRecordings(folder=self.folder)
