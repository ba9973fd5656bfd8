"""Actions that make motions: variations of a base, of a motion, and of a composed base."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mograft.config import Config, scale_of_variety
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.provenance.graft_revision import regenerate
from mograft.scenario import Scenario, follow, to_beats, transitions, walk
from mograft.studio.actions.fields import Fields
from mograft.studio.desk import Desk, find_clip
from mograft.studio.project import Lock, Project, ProjectMotion
from mograft.studio.workshop import renamed
from mograft.synthesis.graft import graft_many
from mograft.synthesis.graft_result import Graft
from mograft.viewing.geometry import DrawnSkeleton

_MAX_COUNT = 64
_MAX_SECONDS = 600.0
_CHANGED_SHARE = 0.4  # of the segments, in motions like another one


def make(desk: Desk, fields: Fields) -> tuple[Project, str]:
    """Make motions on a clip."""
    library = _library(desk, fields)
    base, count = fields.optional_text("base"), fields.integer("count", 1, 1, _MAX_COUNT)
    if base is None:
        base = library.names[0]
    find_clip(library, "base", base)
    n_before = desk.project.n_made
    grafts = _make(desk, fields, library, base, None, count)
    project = _add(desk, grafts, f"make {count} on {base}", count)
    return project, f"make {project.n_made - n_before} on {base}"


def compose(desk: Desk, fields: Fields) -> tuple[Project, str]:
    """Make motions on a base that is composed of segments, along a path or to beats."""
    library, points = _library(desk, fields), fields.points("points")
    count, seed = fields.integer("count", 1, 1, _MAX_COUNT), desk.project.n_made
    duration, tempo = fields.number("duration"), fields.number("tempo")
    if len(points) > 1 and tempo is not None:
        raise ValueError("give either a path (`points`) or a tempo")
    if len(points) < 2 and duration is None:
        raise ValueError("give either a path of two points or more (`points`) or a `duration`")
    if duration is not None and not 0 < duration <= _MAX_SECONDS:
        raise ValueError(f"`duration` must be up to {_MAX_SECONDS:g} seconds, got {duration:g}")
    if tempo is not None and not 20 <= tempo <= 60 * library.rate:
        raise ValueError(f"`tempo` must be 20 to {60 * library.rate:g} per minute, got {tempo:g}")
    graph = transitions(library)
    if len(points) > 1:
        found = follow(library, _on_floor(library.clips[0], points), graph=graph)
        text = "along the path"
    elif tempo is not None and duration is not None:
        beats = np.arange(int(duration * tempo / 60.0) + 1) * (60.0 / tempo)
        found = to_beats(library, beats, seed, graph=graph)
        text = f"to {tempo:g} beats per minute"
    else:
        found = Scenario(walk(library, duration or 0.0, seed, graph=graph))
        text = f"of {duration:g} seconds"
    grafts = _make(desk, fields, library, None, found, count)
    return _add(desk, grafts, f"make {count} {text}", count), f"make {count} {text}"


def _on_floor(motion: Motion, points: Sequence[Sequence[float]]) -> np.ndarray:
    """Return points x, z of the page's floor in the horizontal axes of a motion's file."""
    to_page = DrawnSkeleton.of(motion[:1]).to_y_up
    flat = np.array([[x, 0.0, z] for x, z in points]) @ to_page
    up = int(np.abs(to_page[1]).argmax())
    return np.delete(flat, up, axis=1)


def more_like(desk: Desk, fields: Fields) -> tuple[Project, str]:
    """Make motions that share most donors with a motion; those of locked segments are kept."""
    own = desk.project.motion(fields.values.get("id"))
    count = fields.integer("count", 3, 1, _MAX_COUNT)
    graft, project = desk.workshop.editable(own.record), desk.project
    locked = [(lock.group, lock.frames) for lock in own.locks]

    def variants() -> Iterable[Graft]:
        for number in range(count):
            seed = project.n_made + number
            rng = np.random.default_rng([0, seed])
            chosen = rng.random(len(graft.substitutions)) < _CHANGED_SHARE
            pairs = zip(graft.substitutions, chosen.tolist(), strict=True)
            ranges = [(each.group, (each.start, each.stop)) for each, is_open in pairs if is_open]
            yield regenerate(graft, ranges, seed, locked=locked)

    name, text = desk.name_of(own), f"make {count} like {desk.name_of(own)}"
    return _add(desk, variants(), text, count, stem=name, locks=own.locks), text


def _library(desk: Desk, fields: Fields) -> Library:
    """Return the library with the options of new motions, and those of an action."""
    library, variety = desk.ready_library(), fields.number("variety")
    changes: dict[str, Any] = {"loop": "on"} if fields.flag("loop") else {}
    changes |= {} if variety is None else {"sigma_scale": scale_of_variety(variety)}
    config = Config.from_dict(library.config.as_dict() | dict(desk.project.config) | changes)
    return desk.workshop.configured(library, config)


def _make(
    desk: Desk,
    fields: Fields,
    library: Library,
    base: str | None,
    scenario: Scenario | None,
    count: int,
) -> Iterable[Graft]:
    is_fixed = fields.has("variety") or "sigma_scale" in desk.project.config
    grafts = graft_many(
        library,
        base,
        count,
        swap=fields.items("swap", str) or None,
        seed=fields.integer("seed", desk.project.n_made),
        scenario=scenario,
        widen=not is_fixed,
    )
    for note in grafts.notes:
        desk.note(note)
    return grafts


def _add(
    desk: Desk,
    grafts: Iterable[Graft],
    text: str,
    count: int,
    *,
    stem: str | None = None,
    locks: tuple[Lock, ...] = (),
) -> Project:
    """Return the project with new motions, which are shown as soon as each is made."""
    project = before = desk.project
    taken = {desk.name_of(own) for own in project.motions}
    with desk.job(text, count) as advance:
        for graft in grafts:
            number = project.n_made + 1
            name = f"{stem or graft.base.name or 'scenario'}_graft{number}"
            while name in taken:
                name += "_"
            key = desk.workshop.add(renamed(graft, name), desk.source_names)
            made = ProjectMotion(id=f"m{number}", record=key, locks=locks)
            project = replace(project, motions=(*project.motions, made), n_made=number)
            desk.show(project)
            advance()
    if project is before:
        raise ValueError("the donors allow no motion: raise `variety` or add clips")
    return project
