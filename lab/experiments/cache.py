"""Results of experiments, stored as JSON files under the version of the code and of the inputs."""

import hashlib
import json
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
_UNRELATED = ("cli", "viewing", "plot")  # packages on which no result depends


def code_version(modules):
    """Return a checksum of the package, of its kernels and of modules of the laboratory."""
    package = ROOT / "python" / "mograft"
    files = [
        path
        for path in sorted(package.rglob("*.py"))
        if path.relative_to(package).parts[0] not in _UNRELATED
    ]
    files += sorted((ROOT / "rust").rglob("*.rs"))
    files += [Path(__file__).with_name("sources.py")]
    files += [Path(module.__file__) for module in modules]
    checksum = hashlib.sha256()
    for path in files:
        checksum.update(path.read_bytes())
    return checksum.hexdigest()[:12]


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
