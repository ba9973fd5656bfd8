"""Results of experiments, stored as JSON files under the version of the code and of the inputs."""

import ast
import hashlib
import json
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
_UNRELATED = ("cli", "datasets", "provenance", "stream", "studio", "viewing")
"""Packages on which no result depends."""


def code_version(*modules):
    """Return a checksum of the package, its kernels, what experiments share, and `modules`.

    `modules` are modules or paths of their files.

    Comments and docstrings of Python do not count.
    """
    package = ROOT / "python" / "mograft"
    files = [
        path
        for path in sorted(package.rglob("*.py"))
        if path.relative_to(package).parts[0] not in _UNRELATED
    ]
    files += [Path(__file__).with_name(name) for name in ("sources.py", "bases.py")]
    for folder in ("baselines", "donors", "measures"):
        files += sorted((ROOT / "lab" / folder).glob("*.py"))
    files += [own if isinstance(own, Path) else Path(own.__file__) for own in modules]
    checksum = hashlib.sha256()
    for path in files:
        checksum.update(_code(path).encode())
    for path in sorted((ROOT / "rust").rglob("*.rs")):
        checksum.update(path.read_bytes())
    return checksum.hexdigest()[:12]


@cache
def _code(path):
    """Return the syntax tree of a Python file, without its docstrings, as text."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        own = getattr(node, "body", None)
        if isinstance(own, list):
            node.body = [part for part in own if not _is_text(part)]
    return ast.dump(tree)


def _is_text(node):
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def input_version(files):
    """Return a checksum of the names, sizes and contents of files."""
    checksum = hashlib.sha256()
    for path in files:
        checksum.update(path.name.encode())
        checksum.update(path.read_bytes())
    return checksum.hexdigest()[:12]


class Cache:
    """JSON values in a folder, by experiment, source and version."""

    def __init__(self, folder):
        self.folder = Path(folder)

    def _path(self, experiment, source, version):
        return self.folder / f"{experiment}.{source.replace(' ', '-')}.{version}.json"

    def read(self, experiment, source, version, *, is_any_version=False):
        """Return a stored value, or None; of any version, the newest, if `is_any_version`."""
        path = self._path(experiment, source, version)
        if not path.exists() and is_any_version:
            inputs = version.split("-", 1)[1]
            stored = self.folder.glob(self._path(experiment, source, f"*-{inputs}").name)
            path = max(stored, key=lambda own: own.stat().st_mtime, default=path)
        if not path.exists():
            return None
        return json.loads(path.read_text(encoding="utf-8"))

    def write(self, experiment, source, version, value):
        """Store a value."""
        self.folder.mkdir(parents=True, exist_ok=True)
        path = self._path(experiment, source, version)
        draft = path.with_suffix(".draft")
        draft.write_text(json.dumps(value, indent=1, allow_nan=False), encoding="utf-8")
        draft.replace(path)
