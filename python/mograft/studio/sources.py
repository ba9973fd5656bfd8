"""The inputs of a project: what was found in them, and the library of their clips."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mograft.library.library import Library
from mograft.studio.project import Project

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class Opened:
    """The state of the inputs of a project."""

    library: Library | None = None
    status: str = "none"  # none, building, ready or failed
    done: int = 0
    total: int = 0
    message: str = ""
    sources: tuple[dict[str, Any], ...] = ()
    clips: tuple[dict[str, Any], ...] = ()


def build(project: Project, opened: Opened, progress: Progress) -> Opened:
    """Return the library of the inputs of a project."""
    paths = [own.path for own in project.inputs]
    library = Library.build(
        paths, project.joint_groups, project.full_config, strict=False, progress=progress
    )
    sources = tuple(
        {"path": own, "name": Path(own).name, "clips": 1, "status": "ok", "message": ""}
        for own in paths
    )
    clips = tuple(
        {"name": own.name, "frames": own.n_frames, "rate": library.rate, "faults": []}
        for own in library.entries
    )
    return replace(opened, library=library, status="ready", sources=sources, clips=clips)
