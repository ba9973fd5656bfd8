"""The files that a power failure may leave: writes and names that were not synced can be lost."""

import os
import shutil
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(eq=False)
class _File:
    content: bytes | None = None  # None: that of the file on disk
    is_synced: bool = True


@dataclass(eq=False)
class _Folder:
    entries: dict[str, "_File | _Folder"] = field(default_factory=dict)
    synced: dict[str, "_File | _Folder"] = field(default_factory=dict)


class Disk:
    """A model of the folder `root`: what a log of calls changes, and what of it is synced.

    The model is stricter than file systems are: a file keeps its content only if it was synced
    after the last write, and a folder its entries only if the folder was, each folder by itself.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self._tree = self._scan(root)

    def _scan(self, path):
        folder = _Folder()
        for entry in os.scandir(path):
            own = Path(entry.path)
            folder.entries[entry.name] = (
                self._scan(own) if entry.is_dir() else _File(own.read_bytes())
            )
        folder.synced = dict(folder.entries)
        return folder

    def _find(self, path):
        found = self._tree
        for name in Path(path).relative_to(self._root).parts:
            found = found.entries[name]
        return found

    def replay(self, log):
        """Apply the lines of a log of the preloaded library."""
        for call, _, path, *second in log:
            target = Path(path)
            if call == "sync":
                node = self._find(target)
                if isinstance(node, _Folder):
                    node.synced = dict(node.entries)
                else:
                    node.is_synced = True
                continue
            if call == "write":
                node = self._find(target)
                node.content, node.is_synced = None, False
                continue
            parent = self._find(target.parent)
            if call == "create":
                parent.entries[target.name] = _File(None, is_synced=False)
            elif call == "mkdir":
                parent.entries[target.name] = _Folder()
            elif call == "unlink":
                del parent.entries[target.name]
            elif call in ("link", "rename"):
                source = Path(second[0])
                parent.entries[target.name] = self._find(source)
                if call == "rename":
                    del self._find(source.parent).entries[source.name]

    def load(self):
        """Read the contents of all files, before the folder changes further."""
        self._read(self._tree, self._root)

    def write_lost(self, rng, *, keep_names, keep_data):
        """Replace the folder by one that a power failure may leave.

        Each folder keeps its present entries with the probability `keep_names`, and otherwise has
        those of its last sync. A file that was not synced keeps its content with the probability
        `keep_data`, and otherwise loses its end. `load` must be called before.
        """
        shutil.rmtree(self._root)
        self._write(self._tree, self._root, (rng, keep_names, keep_data))

    def _read(self, folder, path):
        for name, node in folder.entries.items():
            if isinstance(node, _Folder):
                self._read(node, path / name)
            elif node.content is None:
                node.content = (path / name).read_bytes()

    def _write(self, folder, path, loss):
        rng, keep_names, keep_data = loss
        path.mkdir()
        entries = folder.entries if rng.random() < keep_names else folder.synced
        for name, node in entries.items():
            if isinstance(node, _Folder):
                self._write(node, path / name, loss)
                continue
            content = node.content or b""
            if not node.is_synced and rng.random() >= keep_data:
                content = content[: rng.integers(len(content))] if content else b""
            (path / name).write_bytes(content)
