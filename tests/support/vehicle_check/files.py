"""Parameters, files and logs of a fake vehicle."""

import json
import lzma
from math import isfinite
from struct import pack
from typing import Any, ClassVar
from urllib.parse import parse_qs
from zlib import crc32

from tests.support.vehicle_check.core import Peer, mavlink
from tests.support.vehicle_check.streams import Streams
from vehicle_check import transfers as ftp
from vehicle_check.rows.parameter_rows import COMPATIBILITY

INT32, REAL32 = 6, 9
LOGS = {1: bytes(range(256)) * 5, 2: b"log" * 555}


def compatible(name: str) -> float:
    """Return a value that QGroundControl accepts."""
    values = {"MIN": 1000.0, "MAX": 2000.0, "TRIM": 1500.0}
    if name.startswith("INS_"):
        return 0.01
    return values.get(name.partition("_")[2], 0.0) if name.startswith("RC") else 0.0


class Files(Streams):
    """Serves parameters by messages and by FTP, descriptions and logs."""

    own: ClassVar = {"RADIUS_X": 0.5, "WHEELBASE_X": 0.25, "NAVIGATOR_X": 2.0}

    def __init__(self) -> None:
        super().__init__()
        self.values = dict(self.own) | {name: compatible(name) for name in COMPATIBILITY}
        self.kinds = {name: INT32 if name == "NAVIGATOR_X" else REAL32 for name in self.values}
        self.files: dict[str, bytes] = self.described()
        self.sessions: dict[int, bytes] = {}
        self.logs_for: dict[int, list[Any]] = {}

    def described(self) -> dict[str, bytes]:
        """Return the files of the component metadata."""
        rows = [{"name": name, "type": "Float"} for name in self.values]
        inner = lzma.compress(json.dumps({"version": 1, "parameters": rows}).encode())
        link = {"type": 1, "uri": "mftp:///parameters.json.xz", "fileCrc": crc32(inner)}
        general = lzma.compress(json.dumps({"version": 1, "metadataTypes": [link]}).encode())
        self.metadata_crc = crc32(general)
        return {"/general.json.xz": general, "/parameters.json.xz": inner}

    def value(self, name: str) -> Any:
        """Return PARAM_VALUE."""
        names = list(self.values)
        return mavlink.MAVLink_param_value_message(
            name.encode(), self.values[name], self.kinds[name], len(names), names.index(name)
        )

    def on_param_request_list(self, message: Any, peer: Peer) -> None:
        for name in self.values:
            self.send(self.value(name), peer)

    def on_param_request_read(self, message: Any, peer: Peer) -> None:
        names = list(self.values)
        at = message.param_index
        name = message.param_id if at < 0 else names[at] if at < len(names) else ""
        if name in self.values:
            self.send(self.value(name), peer)

    def on_param_set(self, message: Any, peer: Peer) -> None:
        name = message.param_id
        if name in self.values:
            if isfinite(message.param_value) and name not in COMPATIBILITY:
                self.values[name] = message.param_value
            self.send(self.value(name))

    def packed(self, query: str) -> bytes:
        """Return param.pck."""
        options = {key: int(values[0]) for key, values in parse_qs(query).items()}
        start = options.get("start", 0)
        names = list(self.values)[start:][: options.get("count") or None]
        magic = 0x671C if options.get("withdefaults") else 0x671B
        found = pack("<HHH", magic, len(names), len(self.values))
        for name in names:
            head = bytes([4, (len(name) - 1) << 4])
            found += head + name.encode() + pack("<f", self.values[name])
        return found

    def file(self, path: str) -> bytes | None:
        """Return the contents of a file."""
        name, _, query = path.partition("?")
        if name == "@PARAM/param.pck":
            return self.packed(query)
        if name.startswith("@MAV_LOG/"):
            return LOGS.get(int(name[9:-4]))
        return self.files.get(name)

    def on_file_transfer_protocol(self, message: Any, peer: Peer) -> None:
        asked = ftp.reply_of(message.payload)
        answer = self.ftp_answer(asked, peer)
        if answer is not None:
            self.reply(asked, peer, *answer)

    def reply(
        self, asked: ftp.FileReply, peer: Peer, data: bytes | int, offset: int = 0, more: int = 1
    ) -> None:
        """Send an ACK with data, or a NAK with an error."""
        opcode = ftp.NAK if isinstance(data, int) else ftp.ACK
        data = bytes([data]) if isinstance(data, int) else data
        session = asked.session or (1 if asked.opcode == ftp.OPEN else 0)
        head = ftp.HEADER.pack(
            asked.sequence + more & 0xFFFF, session, opcode, len(data), asked.opcode, 0, offset
        )
        payload = list((head + data).ljust(251, b"\0"))
        self.send(
            mavlink.MAVLink_file_transfer_protocol_message(0, peer.system, peer.component, payload),
            peer,
        )

    def ftp_answer(self, asked: ftp.FileReply, peer: Peer) -> tuple[bytes | int, int] | None:
        """Return data or an error, and the offset; None if all is sent."""
        path = asked.data.decode("utf-8", "replace")
        if asked.opcode in (ftp.RESET, ftp.TERMINATE):
            return b"", 0
        if asked.opcode == ftp.LIST:
            return self.listed(path, asked.offset), asked.offset
        if asked.opcode in (ftp.OPEN, ftp.CRC32):
            data = self.file(path)
            if data is None:
                return ftp.FILE_NOT_FOUND, 0
            if asked.opcode == ftp.CRC32:
                return pack("<I", crc32(data)), 0
            self.sessions[1] = data
            return pack("<I", len(data)), 0
        data = self.sessions.get(asked.session)
        if data is None:
            return 4, 0
        if asked.opcode == ftp.READ:
            part = data[asked.offset : asked.offset + asked.size]
            return (part or ftp.END_OF_FILE), asked.offset
        for number, at in enumerate(range(asked.offset, len(data), asked.size), start=1):
            self.reply(asked, peer, data[at : at + asked.size], at, number)
        return None

    def listed(self, path: str, offset: int) -> bytes | int:
        """Return the entries of a folder."""
        folders = {
            "@PARAM": ["Fparam.pck\t100"],
            "@MAV_LOG": [f"F{one}.bin\t{len(data)}" for one, data in LOGS.items()],
        }
        names = folders.get(path, [])[offset:]
        return "\0".join(names).encode() + b"\0" if names else ftp.END_OF_FILE

    def on_log_request_list(self, message: Any, peer: Peer) -> None:
        for number, data in LOGS.items():
            self.send(
                mavlink.MAVLink_log_entry_message(number, len(LOGS), max(LOGS), 0, len(data)), peer
            )

    def on_log_request_data(self, message: Any, peer: Peer) -> None:
        data = b"" if self.is_armed else LOGS.get(message.id, b"")
        end = min(len(data), message.ofs + message.count)
        for at in range(message.ofs, end, 90):
            part = data[at : min(at + 90, end)]
            self.send(
                mavlink.MAVLink_log_data_message(
                    message.id, at, len(part), list(part.ljust(90, b"\0"))
                ),
                peer,
            )
