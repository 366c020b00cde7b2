"""Show any MAVLink vehicle without commanding it: its state, place, messages, parameters, mission.

A value that is stale is faint, with its age in words; one that was never sent is `--`.
"""

from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, ClassVar, Final, Generic, TypeVar

from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Container, Horizontal, Vertical
from textual.filter import LineFilter

from ground.app.appearance import TEXTUAL_THEMES, Appearance
from ground.app.lists.table import Column, ColumnHeads, Table
from ground.app.panels.aged import MISSING, number
from ground.app.widgets.lines import Lines, ListView, LogView, Printable
from ground.app.widgets.map import MapWidget
from ground.app.widgets.rows import Row, Span, cut, faint, head, row
from ground.map.scene import MapScene, MapTarget, RobotMark
from ground.recording.log_writer import LogFile, LogWriter, new_log
from runtime.units import NS_PER_S
from vehicle_check import watch as model
from vehicle_check.networks import VehicleNetwork
from vehicle_check.transfers import PlanItem
from vehicle_check.watch import Freshness, VehicleText, VehicleWatch, WatchedMessage

POLL_HZ: Final = 20.0
ZOOM: Final = 1.25
SIDE: Final = 46
PAGES: Final = ("vehicle", "messages", "parameters", "mission", "texts")
LOSS_PERCENT: Final = 1.0
WARNING: Final = 4
ERROR: Final = 3
NO_BATTERY: Final = -1
UNKNOWN_MV: Final = 65_535
HINT: Final = "read only: heartbeats and requests to read are sent"


def shown(watch: VehicleWatch, name: str, words: Callable[[Any], str], role: str = "text") -> Span:
    """Return a value of the newest message of a name, with its age if it is stale."""
    one = watch.seen(name)
    if one is None:
        return Span(MISSING, "faint")
    if one.freshness(watch.now_ns) is Freshness.LIVE:
        return Span(words(one.newest), role)
    return Span(f"{words(one.newest)} ({one.age_s(watch.now_ns):.0f} s old)", "faint")


def state_rows(watch: VehicleWatch) -> list[Row]:
    """Return the state of the vehicle; every value is a live one, or has its age."""

    def value(name: str, words: Callable[[Any], str]) -> Span:
        return shown(watch, name, words)

    def degrees(one: Any) -> str:
        return f"{one.lat / 1e7:.7f} {one.lon / 1e7:.7f}"

    loss = watch.loss_percent()
    lost = faint(MISSING) if loss is None else Span(f"{loss:.1f} %", loss_role(loss))
    return [
        row(head(" vehicle  "), value("HEARTBEAT", model.vehicle_name)),
        row(head(" mode     "), value("HEARTBEAT", mode_words)),
        row(head(" state    "), value("HEARTBEAT", state_words)),
        row(head(" place    "), value("GLOBAL_POSITION_INT", degrees)),
        row(
            head(" local    "),
            value("LOCAL_POSITION_NED", lambda one: f"{one.y:.2f} E {one.x:.2f} N m"),
        ),
        row(head(" heading  "), value("ATTITUDE", heading_words)),
        row(head(" speed    "), value("VFR_HUD", lambda one: f"{one.groundspeed:.2f} m/s")),
        row(head(" battery  "), value("SYS_STATUS", battery_words)),
        row(head(" GPS      "), value("GPS_RAW_INT", gps_words)),
        row(head(" mission  "), value("MISSION_CURRENT", lambda one: f"item {one.seq}")),
        row(head(" loss     "), lost),
    ]


def mode_words(one: Any) -> str:
    """Return mode and arming of a heartbeat."""
    return f"{model.mode_name(one)}, {'armed' if model.is_armed(one) else 'disarmed'}"


def state_words(one: Any) -> str:
    """Return the system status of a heartbeat."""
    return model.enum_name("MAV_STATE", one.system_status)


def heading_words(one: Any) -> str:
    """Return the heading of ATTITUDE, clockwise from north."""
    return f"{number(one.yaw * 57.29577951308232 % 360.0, '.0f')}°"


def battery_words(one: Any) -> str:
    """Return voltage and charge of SYS_STATUS, as far as the vehicle knows them."""
    volts = MISSING if one.voltage_battery == UNKNOWN_MV else f"{one.voltage_battery / 1000:.1f} V"
    is_known = one.battery_remaining != NO_BATTERY
    return f"{volts}, {f'{one.battery_remaining} %' if is_known else MISSING}"


def gps_words(one: Any) -> str:
    """Return fix and satellites of GPS_RAW_INT."""
    fix = model.enum_name("GPS_FIX_TYPE", one.fix_type).removeprefix("gps_fix_type_")
    return f"{fix.replace('_', ' ')}, {one.satellites_visible} satellites"


def loss_role(percent: float) -> str:
    """Return the role of a loss."""
    return "caution" if percent >= LOSS_PERCENT else "text"


def scene_of(watch: VehicleWatch) -> MapScene:
    """Return the map: the vehicle, its trail and its mission. It is not live with an old place."""
    place, heading = watch.place(), watch.heading_rad()
    mark = None
    if place is not None:
        mark = RobotMark(place.x_m, place.y_m, float("nan") if heading is None else heading)
    targets = []
    for at, item in enumerate(watch.mission or ()):
        where = None if at == 0 or item is None else watch.place_of(item.x, item.y)
        if where is not None:
            targets.append(MapTarget(where.x_m, where.y_m, number=at))
    return MapScene(
        robot=mark, live=mark is None or watch.has_live_place, placed=mark is not None,
        trail=tuple((one.x_m, one.y_m) for one in watch.trail), mission=tuple(targets),
    )  # fmt: skip


def message_columns(watch: VehicleWatch) -> tuple[Column[WatchedMessage], ...]:
    """Return the columns of the messages."""

    def role(one: WatchedMessage) -> str:
        return "text" if one.freshness(watch.now_ns) is Freshness.LIVE else "faint"

    def loss(one: WatchedMessage) -> float | None:
        return watch.losses[one.component].percent(watch.now_ns)

    def age(one: WatchedMessage) -> str:
        is_live = one.freshness(watch.now_ns) is Freshness.LIVE
        return "live" if is_live else f"{one.age_s(watch.now_ns):.0f} s"

    return (
        Column("message", 30, lambda one: one.name, role=role),
        Column("from", 5, lambda one: str(one.component), role=role, numeric=True),
        Column("rate", 7, lambda one: f"{one.rate_hz(watch.now_ns):.1f}", unit="Hz", role=role,
               order=lambda one: one.rate_hz(watch.now_ns), numeric=True),
        Column("age", 7, age, role=role, order=lambda one: one.age_s(watch.now_ns), numeric=True),
        Column("loss", 7, lambda one: number(loss(one), ".1f"), unit="%", role=role, order=loss,
               numeric=True),
        Column("count", 9, lambda one: str(one.count), role=role, order=lambda one: one.count,
               numeric=True),
    )  # fmt: skip


Parameter = tuple[str, float]
PARAMETER_COLUMNS: Final = (
    Column[Parameter]("parameter", 20, lambda one: one[0]),
    Column[Parameter]("value", 16, lambda one: f"{one[1]:.7g}",
                      order=lambda one: one[1], numeric=True),
)  # fmt: skip
Item = tuple[int, PlanItem | None]


def of_item(words: Callable[[PlanItem], str]) -> Callable[[Item], str]:
    """Return a text of items; that of an item that has not arrived is missing."""
    return lambda one: MISSING if one[1] is None else words(one[1])


ITEM_COLUMNS: Final = (
    Column[Item]("item", 5, lambda one: str(one[0]), lambda one: one[0], numeric=True),
    Column[Item]("command", 26, of_item(lambda item: model.command_name(item.command))),
    Column[Item]("latitude", 13, of_item(lambda item: f"{item.x / 1e7:.7f}"), numeric=True),
    Column[Item]("longitude", 13, of_item(lambda item: f"{item.y / 1e7:.7f}"), numeric=True),
    Column[Item]("altitude", 9, of_item(lambda item: f"{item.z:.1f}"), unit="m", numeric=True),
    Column[Item]("parameters", 0, of_item(lambda item: " ".join(f"{p:g}" for p in item.params))),
)

T = TypeVar("T")


class TablePage(Vertical, Generic[T]):
    """A list with heads."""

    def __init__(self, table: Table[T], *, id: str) -> None:
        super().__init__(id=id)
        self.table = table

    def compose(self) -> ComposeResult:
        """Compose heading, heads and list."""
        yield Lines(classes="heading")
        yield ColumnHeads(self.table)
        yield ListView()

    def draw(self, items: Sequence[T], words: str) -> None:
        """Draw the items below some words."""
        view = self.query_one(ListView)
        view.at = self.table.update(items, "", view.at)
        self.query(Lines).first().show([row(faint(f" {words}"))])
        self.query_one(ColumnHeads).draw()
        view.window(self.table.rows, self.table.paint)


class VehicleApp(App[int]):
    """Polls a vehicle and draws it; no key sends a command."""

    CSS_PATH = Path(__file__).with_name("ground.tcss")
    CSS = f"""
    #pages > * {{ display: none; height: 1fr; }}
    #pages > .-chosen {{ display: block; }}
    #pages, TablePage ListView, #texts {{ height: 1fr; width: 1fr; }}
    TablePage ColumnHeads, TablePage .heading {{ height: 1; }}
    #side {{ width: {SIDE}; }}
    """
    TITLE = "sidestep mavlink watch"
    AUTO_FOCUS = ""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("q,ctrl+c,ctrl+q", "leave", "leave", priority=True),
        *(Binding(str(at), f"page({at - 1})", name) for at, name in enumerate(PAGES, start=1)),
        Binding("tab", "next_page", "next", priority=True),
        Binding("r", "record", "record"),
        Binding("a", "read_again", "read again"),
        Binding("s", "sort", "sort"),
        Binding("plus,equals_sign", "zoom(1)", "zoom in"),
        Binding("minus", "zoom(-1)", "zoom out"),
        Binding("f", "fit", "fit"),
        *(Binding(key, f"scroll({rows})", "scroll") for key, rows in (
            ("up", -1), ("down", 1), ("pageup", -20), ("pagedown", 20),
            ("home", -1_000_000), ("end", 1_000_000),
        )),
    ]  # fmt: skip

    def __init__(
        self,
        network: VehicleNetwork,
        system: int,
        folder: Path,
        utc_offset_ns: int = 0,
        appearance: Appearance | None = None,
    ) -> None:
        super().__init__()
        self.appearance = appearance or Appearance()
        self.watched = VehicleWatch(network, system, self._record)
        self._folder, self._utc_offset_ns, self._page = folder, utc_offset_ns, 0
        self._writer: LogWriter | None = None
        self._path: Path | None = None
        self._note = HINT
        self._printable = Printable()
        for theme in TEXTUAL_THEMES:
            self.register_theme(theme)
        self.theme = self.appearance.theme
        self.set_class(self.appearance.ascii_only, "-ascii")

    def compose(self) -> ComposeResult:
        """Compose status, tabs and pages."""
        yield Lines(id="status")
        yield Lines(id="tabs")
        with Container(id="pages"):
            with Horizontal(id="vehicle"):
                yield MapWidget(ascii_only=self.appearance.ascii_only, id="map")
                yield Lines(id="side")
            columns = message_columns(self.watched)
            yield TablePage(
                Table(columns, key=lambda one: (one.component, one.name)), id="messages"
            )
            yield TablePage(Table(PARAMETER_COLUMNS, key=lambda one: one[0]), id="parameters")
            yield TablePage(Table(ITEM_COLUMNS, key=lambda one: one[0]), id="mission")
            yield LogView(id="texts")
        yield Lines(id="keybar")

    def on_mount(self) -> None:
        """Start the timers."""
        self.action_page(0)
        if self.appearance.hz:
            self.set_interval(1.0 / POLL_HZ, self.poll)
            self.set_interval(1.0 / self.appearance.hz, self.draw)

    def on_unmount(self) -> None:
        """End a recording."""
        self._end_recording()

    @property
    def defect(self) -> Exception | None:
        """The unexpected exception that ended the app, if any."""
        return self._exception

    def _fatal_error(self) -> None:
        """End without Textual's page of local variables; the caller reports `defect`."""
        self._close_messages_no_wait()

    def get_line_filters(self) -> Sequence[LineFilter]:
        """Return Textual's filters and ours: names of the vehicle may hold control characters."""
        return [*super().get_line_filters(), self._printable]

    def poll(self) -> None:
        """Exchange what is due with the vehicle, and write what is recorded."""
        self.watched.poll()
        if self._writer is not None and not self._writer.flush():
            self._note = f"recording ended: {self._writer.error}"
            self._end_recording()

    def draw(self) -> None:
        """Draw the page that is chosen."""
        watch, width = self.watched, self.size.width
        if not width:
            return
        self.query_one("#status", Lines).show([cut(self._status(), width)])
        self.query_one("#tabs", Lines).show([cut(self._tabs(), width)])
        keys = " q leave  1-5, Tab pages  r record  a read again  s sort  + - f map"
        self.query_one("#keybar", Lines).show([cut(row(faint(keys)), width)])
        page = PAGES[self._page]
        if page == "vehicle":
            chart = self.query_one(MapWidget)
            chart.paint(self.theme)
            chart.show(scene_of(watch))
            newest = [text_row(one) for one in list(watch.texts)[-self.size.height :]]
            rows = [*state_rows(watch), (), *newest]
            self.query_one("#side", Lines).show([cut(one, SIDE - 1) for one in rows])
        elif page == "messages":
            kinds = model.sorted_messages(watch)
            self._table(page).draw(kinds, f"{len(kinds)} kinds of messages")
        elif page == "parameters":
            listed = watch.parameters
            words = f"{len(listed.values)} of {listed.count} parameters" if listed.count else "none"
            found = [(name, watch.number(one)) for name, one in sorted(listed.values.items())]
            self._table(page).draw(found, f"{words}, as they were read")
        elif page == "mission":
            items = list(enumerate(watch.mission or ()))
            words = "no mission was sent" if watch.mission is None else f"{len(items)} items"
            self._table(page).draw(items, f"{words}, as they were read")
        else:
            self.query_one("#texts", LogView).window(list(watch.texts), text_row)

    def _table(self, page: str) -> TablePage[Any]:
        return self.query_one(f"#{page}", TablePage)

    def _status(self) -> Row:
        """Return the first row: the vehicle, and whether it is heard."""
        watch = self.watched
        if not watch.system:
            waited = (watch.now_ns - watch.began_ns) / NS_PER_S
            return row(Span(f" no vehicle heard for {waited:.0f} s", "caution"))
        state = shown(watch, "HEARTBEAT", mode_words, "accent")
        is_live = watch.freshness("HEARTBEAT") is Freshness.LIVE
        link = Span("  live", "ok") if is_live else Span("  NOT LIVE", "danger")
        record = Span(f"  REC {self._path}", "danger") if self._path else faint(f"  {self._note}")
        return row(head(f" system {watch.system}  "), state, link, record)

    def _tabs(self) -> Row:
        """Return the tabs; the chosen one is reversed."""
        return tuple(
            Span(f" {at + 1} {name} ", "reverse" if at == self._page else "head")
            for at, name in enumerate(PAGES)
        )

    # Keys.

    def action_leave(self) -> None:
        """Leave."""
        self.exit(0)

    def action_page(self, page: int) -> None:
        """Choose a page."""
        self._page = page
        for name in PAGES:
            self.query_one(f"#{name}").set_class(name == PAGES[page], "-chosen")
        self.draw()

    def action_next_page(self) -> None:
        """Choose the next page."""
        self.action_page((self._page + 1) % len(PAGES))

    def action_scroll(self, rows: int) -> None:
        """Scroll the list of the page."""
        for view in self.query(".-chosen ListView, LogView.-chosen"):
            assert isinstance(view, ListView | LogView)
            view.move(rows)
        self.draw()

    def action_sort(self) -> None:
        """Sort the list of the page by its next column."""
        for page in self.query(TablePage):
            if page.has_class("-chosen"):
                page.table.sort_by_next()
        self.draw()

    def action_zoom(self, direction: int) -> None:
        """Zoom the map."""
        self.query_one(MapWidget).zoom(ZOOM**direction)

    def action_fit(self) -> None:
        """Show the whole map again."""
        self.query_one(MapWidget).fit()

    def action_read_again(self) -> None:
        """Read parameters and mission again."""
        self.watched.read_again()

    def action_record(self) -> None:
        """Begin a recording, or end it."""
        if self._writer is not None:
            self._end_recording()
            return
        try:
            file: LogFile = new_log(
                self._folder, f"mavlink{self.watched.system}", datetime.now(UTC)
            )
        except OSError as error:
            self._note = f"cannot record to {self._folder}: {error.strerror or error}"
            return
        self._path, self._writer = file.path, LogWriter(file, self._utc_offset_ns)
        self.draw()

    def _record(self, frame: bytes, at_ns: int) -> None:
        """Keep a frame of any system, if it is recorded; never a key of a signed link."""
        if self._writer is not None and not model.is_secret(frame):
            self._writer.take("mavlink", frame, at_ns)

    def _end_recording(self) -> None:
        if self._writer is not None:
            is_whole = self._writer.close()
            lost = "" if is_whole else f", {self._writer.dropped} frames lost"
            self._note = f"recorded {self._path}{lost}"
        self._writer = self._path = None


def text_row(one: VehicleText) -> Row:
    """Return a text of the vehicle with its time."""
    role = "danger" if one.severity <= ERROR else "caution" if one.severity == WARNING else "text"
    return row(faint(f" {one.at_s:7.1f} "), Span(one.text, role))
