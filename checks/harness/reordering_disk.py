"""A disk in memory, in the place of the module `os` of the code under test.

Content is durable only after an fsync of the file, and a name only after an fsync of its directory.
Until then each write may be there as a whole, in part, as zeros or not at all. Any subset of the
changes of names may be there, in their order; a rename is atomic.
"""

import os
import stat
from collections.abc import Iterator
from errno import EEXIST, EISDIR, ENOENT
from itertools import chain, combinations, product
from pathlib import Path, PurePath
from typing import Final, TypeAlias

State: TypeAlias = frozenset[tuple[str, bytes]]
"""The files after a restart: path and content of each."""

Change: TypeAlias = tuple[str | None, str | None, int]
"""A change of names in a directory: the removed name, the added name and its file."""


class DiskFile:
    """The content of a file now, and each content that it may have after a cut."""

    def __init__(self) -> None:
        self.content = self.synced = b""
        self.after_cut: set[bytes] = {b""}

    def write(self, content: bytes) -> None:
        """Change the content."""
        self.content = content
        half = len(content) // 2
        self.after_cut |= {content, content[:half], bytes(len(content)), content[:half] + b"\0"}

    def sync(self) -> None:
        """Make the content durable."""
        self.synced, self.after_cut = self.content, {self.content}


class Folder:
    """The names of a directory, the durable names, and the changes in between."""

    def __init__(self) -> None:
        self.names: dict[str, int] = {}
        self.durable: dict[str, int] = {}
        self.changes: list[Change] = []

    def change(self, gone: str | None, come: str | None, number: int) -> None:
        """Remove a name, add a name, or both."""
        apply(self.names, (gone, come, number))
        self.changes.append((gone, come, number))

    def sync(self) -> None:
        """Make the names durable."""
        self.durable, self.changes = dict(self.names), []

    def after_cut(self) -> list[dict[str, int]]:
        """Return the possible names after a cut."""
        found = []
        for count in range(len(self.changes) + 1):
            for some in combinations(self.changes, count):
                names = dict(self.durable)
                for change in some:
                    apply(names, change)
                if names not in found:
                    found.append(names)
        return found


class ReorderingDisk:
    """Replaces `os` by the functions that the code under test may use.

    `cuts[n]` holds each state that a power cut right after operation n may leave. Operation 0 is
    the empty disk.
    """

    O_WRONLY: Final = os.O_WRONLY
    O_RDONLY: Final = os.O_RDONLY
    O_CREAT: Final = os.O_CREAT
    O_TRUNC: Final = os.O_TRUNC
    O_NONBLOCK: Final = os.O_NONBLOCK
    O_CLOEXEC: Final = os.O_CLOEXEC
    O_DIRECTORY: Final = os.O_DIRECTORY

    def __init__(self, home: str = "/state") -> None:
        """Create an empty, durable directory `home`."""
        self.path = self
        self.cuts: list[frozenset[State]] = []
        self._nodes: list[DiskFile | Folder] = [Folder()]
        self._open: dict[int, int] = {}
        self._at: dict[int, int] = {}
        """How much has been read of an open file."""
        for folder in (*reversed(PurePath(home).parents), PurePath(home)):
            if folder != PurePath("/"):
                self.mkdir(folder)
                self._folder(folder.parent).sync()
        self.cuts = [self._states()]

    # Functions of `os`.

    def realpath(self, path: Path) -> str:
        """Return the path itself."""
        return str(path)

    def isdir(self, path: Path) -> bool:
        """Return whether a path is a directory."""
        number = self._find(path)
        return number is not None and isinstance(self._nodes[number], Folder)

    def open(self, path: Path, flags: int, mode: int = 0o777) -> int:
        """Open a file or a directory."""
        number = self._find(path)
        if number is None:
            if not flags & os.O_CREAT:
                raise FileNotFoundError(ENOENT, "No such file or directory", str(path))
            number = self._new(path, DiskFile())
        node = self._nodes[number]
        if isinstance(node, Folder) and flags & os.O_WRONLY:
            raise IsADirectoryError(EISDIR, "Is a directory", str(path))
        if isinstance(node, DiskFile) and flags & os.O_TRUNC and node.content:
            node.write(b"")
            self._done()
        handle = 3 + max(self._open, default=0)
        self._open[handle], self._at[handle] = number, 0
        return handle

    def fstat(self, _handle: int) -> os.stat_result:
        """Return that it is a regular file."""
        return os.stat_result((stat.S_IFREG, *(0,) * 9))

    def read(self, handle: int, size: int) -> bytes:
        """Return the next bytes of a file; it does not change while it is read."""
        node, at = self._nodes[self._open[handle]], self._at[handle]
        assert isinstance(node, DiskFile)
        self._at[handle] += size
        return node.content[at : at + size]

    def write(self, handle: int, data: bytes) -> int:
        """Append to a file."""
        node = self._nodes[self._open[handle]]
        assert isinstance(node, DiskFile)
        node.write(node.content + data)
        self._done()
        return len(data)

    def fsync(self, handle: int) -> None:
        """Make a file or a directory durable."""
        self._nodes[self._open[handle]].sync()
        self._done()

    def close(self, handle: int) -> None:
        """Close a file."""
        del self._open[handle]

    def replace(self, old: Path, new: Path) -> None:
        """Rename a file within its directory."""
        number = self._find(old)
        if number is None:
            raise FileNotFoundError(ENOENT, "No such file or directory", str(old))
        assert old.parent == new.parent, "within one directory"
        self._folder(old.parent).change(old.name, new.name, number)
        self._done()

    def lstat(self, path: Path) -> None:
        """Raise FileNotFoundError unless there is a file or a directory of this name."""
        if self._find(path) is None:
            raise FileNotFoundError(ENOENT, "No such file or directory", str(path))

    def unlink(self, path: Path) -> None:
        """Remove a file."""
        if self._find(path) is None:
            raise FileNotFoundError(ENOENT, "No such file or directory", str(path))
        self._folder(path.parent).change(path.name, None, 0)
        self._done()

    def mkdir(self, path: PurePath) -> None:
        """Create a directory."""
        if self._find(path) is not None:
            raise FileExistsError(EEXIST, "File exists", str(path))
        self._new(path, Folder())

    # Functions for tests.

    def isdir_open(self, handle: int) -> bool:
        """Return whether an open file is a directory."""
        return isinstance(self._nodes[self._open[handle]], Folder)

    def content(self, path: Path) -> bytes:
        """Return the content of a file now."""
        number = self._find(path)
        node = None if number is None else self._nodes[number]
        assert isinstance(node, DiskFile)
        return node.content

    # States after a cut.

    def _done(self) -> None:
        self.cuts.append(self._states())

    def _states(self) -> frozenset[State]:
        return frozenset(frozenset(files.items()) for files in self._below(0, ""))

    def _below(self, number: int, path: str) -> Iterator[dict[str, bytes]]:
        """Yield each set of files that may be below a directory after a cut."""
        folder = self._nodes[number]
        assert isinstance(folder, Folder)
        for names in folder.after_cut():
            choices = [list(self._leads_to(at, f"{path}/{name}")) for name, at in names.items()]
            for chosen in product(*choices):
                yield dict(chain.from_iterable(files.items() for files in chosen))

    def _leads_to(self, number: int, path: str) -> Iterator[dict[str, bytes]]:
        node = self._nodes[number]
        if isinstance(node, Folder):
            yield from self._below(number, path)
        else:
            yield from ({path: content} for content in sorted(node.after_cut))

    def _new(self, path: PurePath, node: DiskFile | Folder) -> int:
        self._nodes.append(node)
        number = len(self._nodes) - 1
        self._folder(path.parent).change(None, path.name, number)
        self._done()
        return number

    def _folder(self, path: PurePath) -> Folder:
        number = self._find(path)
        folder = None if number is None else self._nodes[number]
        if not isinstance(folder, Folder):
            raise FileNotFoundError(ENOENT, "No such file or directory", str(path))
        return folder

    def _find(self, path: PurePath) -> int | None:
        number = 0
        for name in path.parts[1:]:
            node = self._nodes[number]
            if not isinstance(node, Folder) or name not in node.names:
                return None
            number = node.names[name]
        return number


def apply(names: dict[str, int], change: Change) -> None:
    """Apply a change to names."""
    gone, come, number = change
    if gone is not None:
        names.pop(gone, None)
    if come is not None:
        names[come] = number


def content_of(state: State, path: Path) -> bytes | None:
    """Return the content of a file after a cut; None if there is no such file."""
    return dict(state).get(str(path))
