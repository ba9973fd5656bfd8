# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators that change one part of a graft; the result is a preview until it is accepted."""

import json

import bpy
from bpy.props import BoolProperty, EnumProperty, IntProperty, StringProperty

import mograft as mg

from .actions import preview, write_results
from .armature import RefusedError
from .curves import frames_of
from .grafting import change
from .operators import UNSAVED, _Armature, request_of, violation_of
from .sources import BEFORE, EDIT, PARENT, RECORD, Setup, load, restore_others
from .work import WorkOperator

SUFFIX = "_preview"
EDITS = (
    ("NEXT", "Next Part", "Give the selected range the next best part of the sources"),
    ("CHOOSE", "Choose Part", "Give the selected range a part of an action that you name"),
    ("KEEP", "Keep Captured", "Give the selected range the captured motion of the base"),
    (
        "REGENERATE",
        "Regenerate Range",
        "Draw the preview range of the timeline, or the selected range, again",
    ),
)
"""The changes, with the text of their buttons."""


def active_graft(context):
    """Return the action of the active armature if it is a graft; else None."""
    data = context.object.animation_data if context.object else None
    action = data.action if data else None
    return action if action is not None and RECORD in action else None


def selected_range(action):
    """Return the selected range of a graft; raise RefusedError if there is none."""
    ranges, active = action.mograft.ranges, action.mograft.active
    if not 0 <= active < len(ranges):
        raise RefusedError("Select a range in the list")
    return ranges[active]


class MOGRAFT_OT_change(WorkOperator, _Armature, bpy.types.Operator):
    """Change the selected range of a graft; the result is a preview"""

    bl_idname = "mograft.change"
    bl_label = "Change"

    kind: EnumProperty(name="Change", items=EDITS)
    clip: StringProperty(name="Action", options=UNSAVED)
    first: IntProperty(name="First frame (0: the best part)", options=UNSAVED)
    last: IntProperty(name="Last frame", options=UNSAVED)

    @classmethod
    def description(cls, _context, properties):
        """Return what the button does."""
        return next(own[2] for own in EDITS if own[0] == properties.kind)

    @classmethod
    def poll(cls, context):
        """Return whether the armature shows a graft."""
        cls.poll_message_set("Show a graft on the armature first")
        return super().poll(context) and active_graft(context) is not None

    def prepare(self, context):
        """Read the graft and the actions of which it is made."""
        action = active_graft(context)
        if action.library is not None:
            raise RefusedError(f"{action.name} is linked: make it local to change it")
        setup = Setup.from_action(action)
        loaded = load(setup)
        clip = json.loads(action[RECORD])["base"]
        edit, stored, source = self.edit_of(context, action, loaded.first[clip])
        request, record = request_of(loaded, restore_others(setup)), action[source]
        self._state = context.object, loaded, action, stored, record
        return lambda report: change(request, record, edit, report)

    def finish(self, context, result):
        """Write the preview in place of an earlier one, and show it."""
        owner, loaded, action, stored, before = self._state
        self.warn(result.notes)
        if result.graft.violations:
            first = loaded.first[result.graft.base.name]
            raise RefusedError(violation_of(result.graft, first))
        parent = action.get(PARENT, action.name)
        (made,) = write_results(loaded, [result], [f"{parent[:50]}{SUFFIX}"])
        made[PARENT], made[BEFORE], made[EDIT] = parent, before, json.dumps(stored)
        _restore_selection(action.mograft, made.mograft)
        preview(owner, made)
        if PARENT in action:
            name = action.name
            bpy.data.actions.remove(action)
            made.name = name
        context.scene.frame_set(context.scene.frame_current)
        self.report({"INFO"}, "Preview: accept or discard it")

    def invoke(self, context, event):
        """Ask for the part of a clip that replaces the selected one."""
        if self.kind == "CHOOSE" and not self.clip:
            return context.window_manager.invoke_props_dialog(self)
        return super().invoke(context, event)

    def draw(self, _context):
        """Draw the dialog."""
        self.layout.prop_search(self, "clip", bpy.data, "actions")
        self.layout.prop(self, "first")
        self.layout.prop(self, "last")

    def edit_of(self, context, action, first):
        """Return the change as a function of a graft, what a preview stores of it, and of which.

        A repeated Next Part starts from the graft before the last change.
        """
        scene = context.scene
        if self.kind == "REGENERATE":
            frames = scene.frame_preview_start - first, scene.frame_preview_end - first
            if not scene.use_preview_range:
                frames = _span(selected_range(action), first)
            locked = [_span(own, first) for own in action.mograft.ranges if own.is_locked]
            seed = int(action["mograft_seed"]) + 1
            return (lambda graft: redraw(graft, frames, locked, seed)), {}, RECORD
        item = selected_range(action)
        group, frames, donor = item.group, _span(item, first), self.clip
        if self.kind == "KEEP":
            keep = mg.constraints.KeepOriginal(frames=frames, group=group)
            return (lambda graft: mg.edit(graft, keep)), {}, RECORD
        if self.kind == "CHOOSE":
            if (self.first, self.last) != (0, 0):
                source = bpy.data.actions.get(donor)
                start = 0 if source is None else frames_of(source)[0]
                donor = self.clip, self.first - start, self.last - start
            return (lambda graft: mg.change(graft, group, frames, donor)), {}, RECORD
        old, rank, source = json.loads(action.get(EDIT, "{}")), 0, RECORD
        if (old.get("group"), old.get("frames")) == (group, list(frames)):
            rank, source = old["rank"] + 1, BEFORE
        stored = {"group": group, "frames": frames, "rank": rank}
        return (lambda graft: mg.change(graft, group, frames, rank=rank)), stored, source


def _restore_selection(old, new):
    """Lock the ranges that are locked in another graft, and select the one that is selected."""
    locked = {(own.group, own.first, own.last) for own in old.ranges if own.is_locked}
    wanted = old.ranges[old.active] if 0 <= old.active < len(old.ranges) else None
    for number, own in enumerate(new.ranges):
        own.is_locked = (own.group, own.first, own.last) in locked
        if wanted is not None and own.group == wanted.group and own.first <= wanted.first:
            new.active = number


def _span(item, first):
    return item.first - first, item.last - first


def redraw(graft, frames, locked, seed):
    """Return a graft with other donors in frames, except in locked ranges."""
    group = next(iter(graft.alternatives))
    cut = [(own.start, own.stop) for own in graft.substitutions if own.group == group]

    def overlaps(segment, span):
        return segment[0] < span[1] and segment[1] > span[0]

    inside = [number for number, own in enumerate(cut) if overlaps(own, frames)]
    chosen = [own for own in inside if not any(overlaps(cut[own], span) for span in locked)]
    if not chosen:
        raise RefusedError("No part in this range of frames can be regenerated: all are locked")
    return mg.edit(graft, *map(mg.constraints.Ban, chosen), seed=seed)


class MOGRAFT_OT_accept(_Armature, bpy.types.Operator):
    """Replace the graft by its preview"""

    bl_idname = "mograft.accept"
    bl_label = "Accept"

    is_accepted: BoolProperty(default=True)

    @classmethod
    def poll(cls, context):
        """Return whether the armature shows a preview."""
        action = active_graft(context)
        return super().poll(context) and action is not None and PARENT in action

    def execute(self, context):
        """Replace the graft, or show it again."""
        action = active_graft(context)
        name = action[PARENT]
        parent = bpy.data.actions.get(name)
        if not self.is_accepted and parent is None:
            self.report({"ERROR"}, f"{name} is missing: accept the preview instead")
            return {"CANCELLED"}
        if not self.is_accepted:
            preview(context.object, parent)
            bpy.data.actions.remove(action)
            return {"FINISHED"}
        for key in (PARENT, BEFORE, EDIT):
            del action[key]
        if parent is not None:
            parent.user_remap(action)
            bpy.data.actions.remove(parent)
        action.name = name
        return {"FINISHED"}


class MOGRAFT_OT_show(_Armature, bpy.types.Operator):
    """Show an action on the armature"""

    bl_idname = "mograft.show"
    bl_label = "Show"

    action: StringProperty()

    def execute(self, context):
        """Assign the action."""
        action = bpy.data.actions.get(self.action)
        if action is None:
            self.report({"ERROR"}, f"{self.action} is missing")
            return {"CANCELLED"}
        preview(context.object, action)
        return {"FINISHED"}
