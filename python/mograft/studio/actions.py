"""The actions of a person: each returns a new project and a text for the history."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from mograft.errors import suggest_name
from mograft.studio.project import Project, ProjectMotion
from mograft.synthesis.graft import graft_many

if TYPE_CHECKING:
    from mograft.studio.session import Session

Action = Mapping[str, Any]


def run(session: "Session", action: Action) -> tuple[Project, str]:
    """Return the project after an action, and the text of the step."""
    name = action.get("action")
    if name not in ACTIONS:
        raise ValueError(f"unknown `action` {name!r}{suggest_name(name, ACTIONS)}")
    return ACTIONS[name](session, action)


def _make(session: "Session", action: Action) -> tuple[Project, str]:
    library = session.workshop.library
    if library is None:
        raise ValueError("the library is not ready: open files and wait")
    project = session.project
    grafts = graft_many(library, action.get("base"), int(action.get("count", 1)))
    for graft in grafts:
        number = project.n_made + 1
        name = f"{graft.base.name}_graft{number}"
        graft = replace(graft, motion=replace(graft.motion, name=name))
        key = session.workshop.add(graft, [own.path for own in project.inputs])
        made = ProjectMotion(id=f"m{number}", record=key)
        project = replace(project, motions=(*project.motions, made), n_made=number)
    return project, f"make {len(grafts)} on {grafts[0].base.name}"


ACTIONS: dict[str, Callable[["Session", Action], tuple[Project, str]]] = {"make": _make}
