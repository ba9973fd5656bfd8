# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators that make grafts: generate, batch and repeat; sources, groups and conditions."""

from dataclasses import replace

import bpy
from bpy.props import BoolProperty, EnumProperty, IntProperty, StringProperty

import mograft as mg

from . import sources
from .actions import preview, push_down, write_results
from .armature import RefusedError
from .curves import frames_of
from .grafting import VARIETIES, Request, change, make
from .groups import read_groups, write_groups
from .scene_constraints import make_constraints
from .work import WorkOperator

UNSAVED = {"SKIP_SAVE"}
"""Buttons that do not set a property use its default, not the value of the last call."""


class _Armature:
    """Operators of the active armature."""

    bl_options = {"UNDO"}  # noqa: RUF012 - as Blender expects

    @classmethod
    def poll(cls, context):
        """Return whether the active object is an armature."""
        if context.object is not None and context.object.type == "ARMATURE":
            return True
        cls.poll_message_set("Select an armature")
        return False


class MOGRAFT_OT_generate(WorkOperator, _Armature, bpy.types.Operator):
    """Make new actions that keep the base and take other parts from the sources"""

    bl_idname = "mograft.generate"
    bl_label = "Generate"

    count: IntProperty(name="Number", min=0, max=1000, options=UNSAVED)
    seed: IntProperty(name="Seed", min=-1, default=-1, options=UNSAVED)
    on_all: BoolProperty(name="On all", options=UNSAVED)

    def prepare(self, context):
        """Read all actions and constraints."""
        owner, settings = context.object, context.object.mograft
        setup, base = sources.collect(context, settings)
        if self.on_all and settings.conditions:
            raise RefusedError("Conditions are for one base: remove them to generate on all")
        loaded = sources.load(setup)
        first, last = frames_of(bpy.data.actions[base])
        constraints, others = make_constraints(
            settings.conditions, first, last, lambda own: sources.read_other(own, setup.rate, first)
        )
        own = [s.clip for s in setup.sources if s.armature == owner.name and not s.file]
        variety = next(own[3] for own in VARIETIES if own[0] == settings.variety)
        request = replace(
            request_of(loaded, others),
            bases=tuple(own if self.on_all else [base]),
            groups=read_groups(loaded.rig, settings.base_group) or settings.preset,
            config=mg.Config.with_variety(variety, loop=settings.loop),
            count=self.count or settings.count,
            seed=settings.seed if self.seed < 0 else self.seed,
            constraints=tuple(constraints),
        )
        self._state = owner, loaded, base
        return lambda report: make(request, report)

    def finish(self, _context, results):
        """Write the new actions."""
        owner, loaded, base = self._state
        first = loaded.first[base]
        violated = [violation_of(own.graft, first) for own in results if own.graft.violations]
        self.warn(results[0].notes)
        results = [own for own in results if not own.graft.violations]
        if not results:
            raise RefusedError(f"No graft meets all conditions: {violated[0]}")
        if violated:
            self.warn([f"{len(violated)} grafts violate conditions: {violated[0]}"])
        if loaded.scaled:
            self.warn([f"Grafts do not consider the scale of bones, as of {loaded.scaled[0]}"])
        made = write_results(loaded, results)
        for own in made if owner.mograft.pushes_down else ():
            push_down(owner, own)
        preview(owner, made[0])
        names = made[0].name if len(made) == 1 else f"{made[0].name} to {made[-1].name}"
        self.report({"INFO"}, f"{names}: {results[0].newness}")


def violation_of(graft, first):
    """Return the first violation of a graft as text, with frames in the time of Blender."""
    own = graft.violations[0]
    start, stop = (first + frame for frame in own.frames)
    return f"frames {start} to {stop}: {own.message.rpartition(': ')[2]}"


def request_of(loaded, others):
    """Return the arguments of `grafting` that all operators have in common."""
    setup, motions = loaded.setup, loaded.motions
    mirrored = setup.is_mirrored
    return Request(motions=motions, match=loaded.match, is_mirrored=mirrored, others=others)


class MOGRAFT_OT_repeat(WorkOperator, _Armature, bpy.types.Operator):
    """Make a graft again from its provenance, and compare it bit for bit"""

    bl_idname = "mograft.repeat"
    bl_label = "Repeat from Provenance"

    action: StringProperty(options=UNSAVED)  # the default is the one that is shown

    def prepare(self, context):
        """Read the sources of a graft."""
        data = context.object.animation_data
        action = bpy.data.actions.get(self.action) if self.action else data and data.action
        setup = sources.Setup.from_action(action)
        loaded, record = sources.load(setup), action[sources.RECORD]
        request = request_of(loaded, sources.restore_others(setup))
        self._state = context.object, loaded, action.name
        return lambda report: change(request, record, None, report)

    def finish(self, _context, result):
        """Write the graft under another name."""
        owner, loaded, name = self._state
        (made,) = write_results(loaded, [result], [f"{name[:50]}_repeat"])
        preview(owner, made)
        self.report({"INFO"}, f"{made.name} is equal to {name}")


class MOGRAFT_OT_add_sources(_Armature, bpy.types.Operator):
    """Add all actions that fit the bones of this armature, or of the other selected armatures"""

    bl_idname = "mograft.add_sources"
    bl_label = "Add Actions"

    def execute(self, context):
        """Add the actions that are not in the list."""
        settings = context.object.mograft
        known = {own.action for own in settings.sources if own.action is not None}
        others = [own for own in context.selected_objects if own.type == "ARMATURE"]
        for owner in dict.fromkeys([context.object, *others]):
            for action in sources.find_actions(owner):
                if action not in known:
                    item = settings.sources.add()
                    item.name, item.action, item.armature = action.name, action, owner
                    known.add(action)
        return {"FINISHED"}


def _libraries(_self, context):
    found = context.preferences.filepaths.asset_libraries
    _libraries.items = [(own.path, own.name, own.path) for own in found]  # Blender keeps no text
    return _libraries.items or [("", "none", "Add one in the preferences, under File Paths")]


class MOGRAFT_OT_add_assets(WorkOperator, _Armature, bpy.types.Operator):
    """Add the actions of an asset library that fit the bones of this armature"""

    bl_idname = "mograft.add_assets"
    bl_label = "Add Asset Library"
    bl_property = "library"

    library: EnumProperty(name="Library", items=_libraries)
    folder: StringProperty(options=UNSAVED)  # or a .blend file, instead of a library

    def invoke(self, context, _event):
        """Show the libraries of the preferences."""
        context.window_manager.invoke_search_popup(self)
        return {"RUNNING_MODAL"}

    def prepare(self, context):
        """Find the actions."""
        path, is_library = self.folder or self.library, not self.folder
        self._found = sources.find_assets(path, context.object, is_library=is_library)
        return lambda _: None

    def finish(self, context, _result):
        """Add the actions that are not in the list."""
        items = context.object.mograft.sources
        known = {(own.file, own.name) for own in items}
        for own in self._found:
            if (own.file, own.action) not in known:
                item = items.add()
                item.name, item.file, item.armature = own.action, own.file, context.object


class MOGRAFT_OT_find_groups(WorkOperator, _Armature, bpy.types.Operator):
    """Show the parts of the body as bone collections, which you can edit"""

    bl_idname = "mograft.find_groups"
    bl_label = "Show Parts as Bone Collections"

    def prepare(self, context):
        """Read the actions in whose skeleton, or motion, the groups are found."""
        settings = context.object.mograft
        loaded = sources.load(sources.collect(context, settings)[0])
        skeleton, preset = loaded.motions[0].skeleton, settings.preset
        own = [m for m in loaded.motions if m.skeleton.names == skeleton.names]
        self._state = context.object, skeleton
        if preset == "auto":
            return lambda _: mg.discover_groups(own).groups
        return lambda _: mg.JointGroups.preset(preset, skeleton)

    def finish(self, _context, groups):
        """Write the groups."""
        owner, skeleton = self._state
        write_groups(owner, skeleton, groups)
        owner.mograft.base_group = groups.base


class MOGRAFT_OT_edit_list(_Armature, bpy.types.Operator):
    """Add or remove a line"""

    bl_idname = "mograft.edit_list"
    bl_label = "Edit List"

    name: EnumProperty(items=[(own, own, "") for own in ("sources", "conditions")])
    is_added: BoolProperty()

    def execute(self, context):
        """Edit the list."""
        settings = context.object.mograft
        items = getattr(settings, self.name)
        active = "active_source" if self.name == "sources" else "active_condition"
        if self.is_added:
            items.add()
            setattr(settings, active, len(items) - 1)
        elif len(items):
            items.remove(getattr(settings, active))
            setattr(settings, active, max(getattr(settings, active) - 1, 0))
        return {"FINISHED"}
