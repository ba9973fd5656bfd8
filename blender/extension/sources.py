# SPDX-License-Identifier: GPL-3.0-or-later
"""The actions of a graft: which they are, as JSON, and their motions."""

import json
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import bpy

from . import armature as rigs
from .armature import Placement, RefusedError
from .curves import BONE_PATH, find_curves, frames_of
from .scene_constraints import avoid_motion

RECORD, SETUP = "mograft_record", "mograft_setup"
BEFORE, EDIT, PARENT = "mograft_before", "mograft_edit", "mograft_parent"
"""Custom properties of new actions: provenance, sources, and those of a preview."""


@dataclass(frozen=True, kw_only=True)
class Source:
    """An action, the armature that it animates, and the file of an asset; empty if it is here."""

    action: str
    armature: str
    file: str = ""

    @property
    def clip(self):
        """The name of its motion."""
        stem = self.file.replace("\\", "/").rpartition("/")[2].removesuffix(".blend")
        return f"{stem}/{self.action}" if self.file else self.action


@dataclass(frozen=True, kw_only=True)
class Setup:
    """All that determines the library of a graft, as JSON values."""

    armature: str
    sources: tuple
    placements: dict  # of each armature
    rate: float
    is_visual: bool = False
    is_mirrored: bool = False
    others: dict = field(default_factory=dict)  # armatures to avoid, by number of the constraint

    @classmethod
    def from_action(cls, action):
        """Return the setup of a graft; raise RefusedError if an action is none."""
        text = "" if action is None else action.get(SETUP, "")
        if not text or RECORD not in action:
            name = "No action" if action is None else action.name
            raise RefusedError(f"{name} is not a graft: choose one that Generate made")
        try:
            values = json.loads(text)
            sources = tuple(Source(**own) for own in values.pop("sources"))
            places = {name: Placement(**own) for name, own in values.pop("placements").items()}
            others = {int(number): own for number, own in values.pop("others").items()}
            return cls(sources=sources, placements=places, others=others, **values)
        except (TypeError, ValueError, KeyError, AttributeError) as error:
            raise RefusedError(f"{SETUP} of {action.name} is damaged") from error


@dataclass(frozen=True)
class Loaded:
    """The motions of a setup, and for each action of the own armature what its writing needs."""

    setup: Setup
    rig: object
    motions: tuple
    outside: dict
    first: dict  # first frame of each clip
    scaled: list  # names of bones whose scale changes

    @property
    def match(self):
        """How the bones of all armatures correspond: by name if all are the same."""
        hierarchies = {(*own.skeleton.names, *own.skeleton.parents) for own in self.motions}
        return "names" if len(hierarchies) == 1 else "anatomy"


def collect(context, settings):
    """Return the setup that a panel describes, and the name of the base clip."""
    owner = context.object
    rigs.check_armature(owner)
    sources = []
    for item in settings.sources:
        if not item.is_used or not (item.file or item.action):
            continue
        armature = item.armature or owner
        rigs.check_armature(armature)
        name = item.name if item.file else item.action.name
        sources.append(Source(action=name, armature=armature.name, file=item.file))
    data = owner.animation_data
    base = data.action if data else None
    if base is not None and RECORD in base:
        base = bpy.data.actions.get(json.loads(base[RECORD])["base"])
    base = settings.base or base
    if base is None:
        has_nla = data is not None and len(data.nla_tracks)
        hint = ", or bake its NLA tracks to an action" if has_nla else ""
        raise RefusedError(f"{owner.name} has no action: choose a base action{hint}")
    if base.library is not None:
        raise RefusedError(f"{base.name} is linked: make it local to use it as a base")
    own = Source(action=base.name, armature=owner.name)
    sources = tuple(dict.fromkeys([own, *sources]))
    armatures = {bpy.data.objects[name]: [] for name in (own.armature for own in sources)}
    for source in sources:
        if not source.file:
            armatures[bpy.data.objects[source.armature]].append(bpy.data.actions[source.action])
    has_object = any(rigs.needs_object(*item) for item in armatures.items())
    placements, size = {}, 0.0
    for armature, actions in armatures.items():
        placed = rigs.place(armature, actions, has_object=has_object)
        extent = rigs.make_rig(armature, placed, is_deform_only=settings.is_visual).rest.extent
        size = size or extent  # that of the base: parts come from figures of its size
        placements[armature.name] = replace(placed, scale=placed.scale * size / extent)
    setup = Setup(
        armature=owner.name,
        sources=sources,
        placements=placements,
        rate=context.scene.render.fps / context.scene.render.fps_base,
        is_visual=settings.is_visual,
        is_mirrored=settings.is_mirrored,
    )
    return setup, own.clip


def load(setup):
    """Read all actions of a setup; raise RefusedError if one is missing."""
    found, motions, outside, first, scaled = {}, [], {}, {}, []
    with linked_actions(setup.sources) as linked:
        for source in setup.sources:
            local = bpy.data.actions.get(source.action)
            action = linked.get(source) if source.file else local
            owner = bpy.data.objects.get(source.armature)
            if action is None or owner is None:
                missing = source.action if action is None else source.armature
                raise RefusedError(f"{missing} is missing: it was deleted or renamed")
            if source.armature not in found:
                rigs.check_armature(owner)
                placed = setup.placements[source.armature]
                found[source.armature] = rigs.make_rig(
                    owner, placed, is_deform_only=setup.is_visual
                )
            rig = found[source.armature]
            if setup.is_visual and not source.file:
                motion, outside[source.clip], own = rigs.sample_visual(rig, action, setup.rate)
            else:
                motion = rigs.read_action(rig, action, setup.rate)
                own = rigs.find_scaled_bones(rig, action)
            scaled += own
            motions.append(replace(motion, name=source.clip))
            first[source.clip] = frames_of(action)[0]
    return Loaded(setup, found[setup.armature], tuple(motions), outside, first, scaled)


def read_other(owner, rate, first):
    """Return the motion of another armature, and what a setup stores of it."""
    rigs.check_armature(owner)
    action = owner.animation_data.action if owner.animation_data else None
    if action is None:
        raise RefusedError(f"{owner.name}, which is to be avoided, has no action")
    placed = rigs.place(owner, [action], has_object=rigs.needs_object(owner, [action]))
    motion = rigs.read_action(rigs.make_rig(owner, placed), action, rate)
    delay = (frames_of(action)[0] - first) / rate
    stored = {"armature": owner.name, "action": action.name, "delay": delay}
    return motion, {**stored, "placement": asdict(placed)}


def restore_others(setup):
    """Return the conditions to avoid armatures, by number, with what the setup stores of them."""
    found = {}
    for number, other in setup.others.items():
        owner = bpy.data.objects.get(other["armature"])
        action = bpy.data.actions.get(other["action"])
        if owner is None or action is None:
            raise RefusedError(f"{other['armature']} or its action, which is avoided, is missing")
        rig = rigs.make_rig(owner, Placement(**other["placement"]))
        motion = rigs.read_action(rig, action, setup.rate)
        frames = None if other["frames"] is None else tuple(other["frames"])
        found[number] = avoid_motion(motion, other, frames), other
    return found


def find_actions(owner, actions=None):
    """Return the actions, by default all local ones but grafts, that fit the bones of an armature.

    At least half of the bones that they animate must be in it.
    """
    found, bones = [], {own.name for own in owner.data.bones}
    if actions is None:
        actions = [own for own in bpy.data.actions if own.library is None and RECORD not in own]
    for action in actions:
        matches = (BONE_PATH.match(path) for path, _ in find_curves(action, owner))
        names = {bpy.utils.unescape_identifier(own[1]) for own in matches if own}
        first, last = frames_of(action)
        if last > first and 0 < len(names) <= 2 * len(names & bones):
            found.append(action)
    return found


def find_assets(path, owner, *, is_library):
    """Return the actions of a .blend file or folder that fit an armature, as sources."""
    folder = Path(bpy.path.abspath(path))
    files = [folder] if folder.is_file() else sorted(folder.rglob("*.blend"))
    if not path or not files:
        raise RefusedError(f"{path or 'The asset library'} has no .blend file")
    sources, old = [], {*bpy.data.libraries}
    for file in map(str, files):
        with _open_file(file, assets_only=is_library) as (inside, _):
            names = list(inside.actions)
        bpy.data.batch_remove({*bpy.data.libraries} - old)
        sources += [Source(action=own, armature=owner.name, file=file) for own in names]
    with linked_actions(sources) as found:
        fitting = find_actions(owner, found.values())
        return [own for own in sources if found.get(own) in fitting]


@contextmanager
def linked_actions(sources):
    """While a block runs, the actions of other files are linked; yield them by source."""
    old, libraries, found = {*bpy.data.actions}, {*bpy.data.libraries}, {}
    try:
        for file in dict.fromkeys(own.file for own in sources if own.file):
            own = {source.action: source for source in sources if source.file == file}
            with _open_file(file) as (inside, linked):
                linked.actions = [name for name in inside.actions if name in own]
            found |= {own[action.name]: action for action in linked.actions if action}
        yield found
    finally:
        bpy.data.batch_remove({*bpy.data.actions} - old)
        bpy.data.batch_remove({*bpy.data.libraries} - libraries)


@contextmanager
def _open_file(file, **options):
    try:
        with bpy.data.libraries.load(file, link=True, **options) as both:
            yield both
    except OSError as error:
        raise RefusedError(f"{file} cannot be read: {error}") from error
