"""Files that a browser sends: their names, and how they reach the folder of the session."""

import filecmp
import shutil
import threading
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Final

from anyio import to_thread

from mograft._util.atomic import draft_folder, sync
from mograft._util.names import portable_stem
from mograft.io.formats import SUFFIXES
from mograft.studio.security import Refusal

FOLDER: Final = "dropped"
"""Folder of these files, in that of the session."""

_COMPANIONS = (".bin", ".png", ".jpg", ".jpeg", ".webp", ".json", ".toml")
"""Suffixes of buffers and textures of glTF files, of projects and provenance, of groups."""

_MAX_LEVELS = 8
_MAX_COPIES = 1000
_MIN_FREE_BYTES = 256 << 20
_placing = threading.Lock()


def upload_path(name: str) -> Path:
    """Return the path, in the folder of the session, of an uploaded file ``[FOLDER/...]NAME``.

    Characters that some system does not allow become ``_``. Raises Refusal if the name could leave
    the folder, is hidden, or has a suffix that no reader of mograft uses.
    """
    parts = name.replace("\\", "/").split("/")
    if len(parts) > _MAX_LEVELS or any(not part or part.startswith(".") for part in parts):
        raise Refusal(
            400, "name", f"a name must have 1 to {_MAX_LEVELS} parts, which do not begin with a dot"
        )
    path = Path(FOLDER, *map(portable_stem, parts))
    if path.suffix.lower() not in (*SUFFIXES, *_COMPANIONS):
        known = ", ".join((*SUFFIXES, *_COMPANIONS))
        raise Refusal(400, "name", f"the name of a file must end in {known}, got {path.name}")
    return path


async def store_upload(parts: AsyncIterator[bytes], n_bytes: int, folder: Path, name: str) -> Path:
    """Write a file of the browser below `folder`; return its path relative to it.

    A file of the same content is used again. A motion file never replaces another one: it gets a
    number. Raises Refusal if the disk is full, or for another file with a different content.
    """
    relative = upload_path(name)
    target = folder / relative
    if shutil.disk_usage(folder).free < n_bytes + _MIN_FREE_BYTES:
        raise Refusal(413, "size", f"the disk of {folder} has too little free space")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise Refusal(409, "exists", f"{relative.parent} is a file, expected a folder") from None
    with draft_folder(target) as folder_of_draft:
        draft = folder_of_draft / target.name
        with draft.open("xb") as stream:
            async for part in parts:
                await to_thread.run_sync(stream.write, part)
        placed = await to_thread.run_sync(_place, draft, target)
    return placed.relative_to(folder)


def _place(draft: Path, target: Path) -> Path:
    sync(draft)
    can_rename = target.suffix.lower() in SUFFIXES
    with _placing:
        for number in range(1, _MAX_COPIES):
            path = target if number == 1 else target.with_stem(f"{target.stem} ({number})")
            if not path.exists():
                draft.replace(path)
                return path
            if path.is_file() and filecmp.cmp(draft, path, shallow=False):
                return path
            if not can_rename:
                break
    raise Refusal(409, "exists", f"{FOLDER}/{target.name} exists with a different content")
