"""The files that a power failure may leave: writes and names that were not synced can be lost."""

import shutil
from pathlib import Path


class _File:
    """A file with its content; None is that of the file on disk."""

    def __init__(self, content=None, *, is_synced=False):
        self.content, self.is_synced = content, is_synced


class _Folder(dict):
    """The entries of a folder by name, and those of its last sync."""

    def __init__(self, entries=()):
        super().__init__(entries)
        self.synced = dict(self)


class Disk:
    """A model of the folder `root`: what a log of calls changes, and what of it is synced.

    The model is stricter than file systems are: a file keeps its content only if it was synced
    after the last write, and a folder its entries only if the folder was, each folder by itself.
    """

    def __init__(self, root: Path, before: Path) -> None:
        """Start with the contents of the folder `before`, which are synced."""
        self._root = root
        self._tree = self._scan(before)

    def _scan(self, path):
        if path.is_file():
            return _File(path.read_bytes(), is_synced=True)
        return _Folder({entry.name: self._scan(entry) for entry in path.iterdir()})

    def _find(self, path):
        found = self._tree
        for name in Path(path).relative_to(self._root).parts:
            found = found[name]
        return found

    def replay(self, log):
        """Apply the lines of a log of the preloaded library, and read the files that it changed.

        The folder must not have changed since.
        """
        for call, _, path, source in log:
            match call:
                case "sync" if isinstance(node := self._find(path), _Folder):
                    node.synced = dict(node)
                case "sync":
                    node.is_synced = True
                case "write":
                    node = self._find(path)
                    node.content, node.is_synced = None, False
                case "create" | "mkdir":
                    node = _File() if call == "create" else _Folder()
                    self._find(Path(path).parent)[Path(path).name] = node
                case "unlink":
                    del self._find(Path(path).parent)[Path(path).name]
                case "link" | "rename":
                    self._find(Path(path).parent)[Path(path).name] = self._find(source)
                    if call == "rename":
                        del self._find(Path(source).parent)[Path(source).name]
        self._read(self._tree, self._root)

    def write_lost(self, rng, keep_names, keep_data):
        """Replace the folder by one that a power failure may leave.

        Each folder keeps its present entries with the probability `keep_names`, and otherwise has
        those of its last sync. A file that was not synced keeps its content with the probability
        `keep_data`, and otherwise loses its end. `replay` must be called before.
        """
        shutil.rmtree(self._root)
        self._write(self._tree, self._root, rng, keep_names, keep_data)

    def _read(self, node, path):
        if isinstance(node, _Folder):
            for name, entry in node.items():
                self._read(entry, path / name)
        elif node.content is None:
            node.content = path.read_bytes()

    def _write(self, node, path, rng, keep_names, keep_data):
        if isinstance(node, _Folder):
            path.mkdir()
            entries = node if rng.random() < keep_names else node.synced
            for name, entry in entries.items():
                self._write(entry, path / name, rng, keep_names, keep_data)
            return
        content = node.content or b""
        if content and not node.is_synced and rng.random() >= keep_data:
            content = content[: rng.integers(len(content))]
        path.write_bytes(content)
