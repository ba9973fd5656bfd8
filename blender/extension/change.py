# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators that change one part of a graft; the result is a preview until it is accepted."""

import json

import bpy
from bpy.props import IntProperty, StringProperty

import mograft as mg

from .actions import preview, write_results
from .armature import RefusedError
from .grafting import change
from .operators import _Armature, request_of
from .properties import is_graft
from .sources import BEFORE, EDIT, PARENT, RECORD, Setup, load
from .work import WorkOperator

SUFFIX = "_preview"


def active_graft(context):
    """Return the action of the active armature if it is a graft; else None."""
    data = context.object.animation_data if context.object else None
    action = data.action if data else None
    return action if is_graft(action) else None


def selected_range(action):
    """Return the selected range of a graft; raise RefusedError if there is none."""
    ranges, active = action.mograft.ranges, action.mograft.active
    if not 0 <= active < len(ranges):
        raise RefusedError("Select a range in the list")
    return ranges[active]


class _Change(WorkOperator, _Armature):
    """Base class: `edit_of` returns a function of a graft, and what the preview stores of it."""

    @classmethod
    def poll(cls, context):
        """Return whether the armature shows a graft."""
        if not super().poll(context):
            return False
        if active_graft(context) is None:
            cls.poll_message_set("Show a graft on the armature first")
            return False
        return True

    def prepare(self, context):
        """Read the graft and the actions of which it is made."""
        action = active_graft(context)
        if action.library is not None:
            raise RefusedError(f"{action.name} is linked: make it local to change it")
        setup = Setup.from_action(action)
        loaded = load(setup)
        clip = json.loads(action[RECORD])["base"]
        edit, stored, source = self.edit_of(context, action, loaded.first[clip])
        request, record = request_of(loaded, setup), action[source]
        self._state = context.object, loaded, action, stored, record
        return lambda report: change(request, record, edit, report)

    def finish(self, context, result):
        """Write the preview in place of an earlier one, and show it."""
        owner, loaded, action, stored, before = self._state
        for note in result.notes:
            self.report({"WARNING"}, note)
        if result.graft.violations:
            raise RefusedError(result.graft.violations[0].message)
        parent = action.get(PARENT, action.name)
        (made,) = write_results(loaded, [result], [f"{parent[:50]}{SUFFIX}"])
        made[PARENT], made[BEFORE], made[EDIT] = parent, before, json.dumps(stored)
        _restore_locks(action, made)
        preview(owner, made)
        if PARENT in action:
            name = action.name
            bpy.data.actions.remove(action)
            made.name = name
        self.report({"INFO"}, "Preview: accept or discard it")
        context.scene.frame_set(context.scene.frame_current)


def _restore_locks(old, new):
    locked = {(own.group, own.first, own.last) for own in old.mograft.ranges if own.is_locked}
    for own in new.mograft.ranges:
        own.is_locked = (own.group, own.first, own.last) in locked
    wanted = old.mograft.ranges[old.mograft.active] if len(old.mograft.ranges) else None
    for number, own in enumerate(new.mograft.ranges):
        if wanted is not None and own.group == wanted.group and own.first <= wanted.first:
            new.mograft["active"] = number


def _span(item, first):
    return item.first - first, item.last - first


class MOGRAFT_OT_next_donor(_Change, bpy.types.Operator):
    """Give the selected range the next best part of the sources"""

    bl_idname = "mograft.next_donor"
    bl_label = "Next Part"

    def edit_of(self, _context, action, first):
        """Return the change by the next rank; repeated, it starts from the graft before."""
        item = selected_range(action)
        group, frames, rank, source = item.group, _span(item, first), 0, RECORD
        old = json.loads(action.get(EDIT, "{}"))
        if (old.get("group"), old.get("frames")) == (group, list(frames)):
            rank, source = old["rank"] + 1, BEFORE
        stored = {"group": group, "frames": frames, "rank": rank}
        return (lambda graft: mg.change(graft, group, frames, rank=rank)), stored, source


class MOGRAFT_OT_choose_donor(_Change, bpy.types.Operator):
    """Give the selected range a part of an action that you name"""

    bl_idname = "mograft.choose_donor"
    bl_label = "Choose Part"

    clip: StringProperty(name="Action")
    first: IntProperty(name="First frame", description="First and last 0: the best part")
    last: IntProperty(name="Last frame")

    def invoke(self, context, event):
        """Ask for the part."""
        if not self.clip:
            item = selected_range(active_graft(context)) if _has_range(context) else None
            if item is None:
                self.report({"ERROR"}, "Select a range in the list")
                return {"CANCELLED"}
            self.clip = item.clip
            self.first = self.last = 0
            return context.window_manager.invoke_props_dialog(self)
        return super().invoke(context, event)

    def edit_of(self, _context, action, first):
        """Return the change by the part."""
        item = selected_range(action)
        group, frames, clip, donor = item.group, _span(item, first), self.clip, self.clip
        if (self.first, self.last) != (0, 0):
            source = bpy.data.actions.get(clip)
            start = 0 if source is None else int(source.frame_range[0])
            donor = clip, self.first - start, self.last - start
        return (lambda graft: mg.change(graft, group, frames, donor)), {}, RECORD


def _has_range(context):
    action = active_graft(context)
    return 0 <= action.mograft.active < len(action.mograft.ranges)


class MOGRAFT_OT_keep_captured(_Change, bpy.types.Operator):
    """Give the selected range the captured motion of the base"""

    bl_idname = "mograft.keep_captured"
    bl_label = "Keep Captured"

    def edit_of(self, _context, action, first):
        """Return the edit that restores the segments of the range."""
        item = selected_range(action)
        keep = mg.constraints.KeepOriginal(frames=_span(item, first), group=item.group)
        return (lambda graft: mg.edit(graft, keep)), {}, RECORD


class MOGRAFT_OT_regenerate(_Change, bpy.types.Operator):
    """Give the preview range of the timeline, or the selected range, other parts by chance"""

    bl_idname = "mograft.regenerate"
    bl_label = "Regenerate Range"

    def edit_of(self, context, action, first):
        """Return the edit that draws the segments again that are not locked."""
        scene = context.scene
        if scene.use_preview_range:
            frames = scene.frame_preview_start - first, scene.frame_preview_end - first
        else:
            frames = _span(selected_range(action), first)
        locked = [_span(own, first) for own in action.mograft.ranges if own.is_locked]
        seed = int(action["mograft_seed"]) + 1
        return (lambda graft: redraw(graft, frames, locked, seed)), {}, RECORD


def redraw(graft, frames, locked, seed):
    """Return a graft with other donors in frames, except in locked ranges."""
    group = next(iter(graft.alternatives))
    cut = [(own.start, own.stop) for own in graft.substitutions if own.group == group]
    chosen = [
        number
        for number, (first, last) in enumerate(cut)
        if first < frames[1]
        and last > frames[0]
        and not any(first < stop and last > start for start, stop in locked)
    ]
    if not chosen:
        raise RefusedError("No part in this range of frames can be regenerated: all are locked")
    return mg.edit(graft, reroll=chosen, seed=seed)


class MOGRAFT_OT_accept(_Armature, bpy.types.Operator):
    """Replace the graft by its preview"""

    bl_idname = "mograft.accept"
    bl_label = "Accept"

    is_accepted: bpy.props.BoolProperty(default=True)

    @classmethod
    def poll(cls, context):
        """Return whether the armature shows a preview."""
        action = active_graft(context)
        return super().poll(context) and action is not None and PARENT in action

    def execute(self, context):
        """Replace the graft, or show it again."""
        action = active_graft(context)
        parent = bpy.data.actions.get(action[PARENT])
        if not self.is_accepted and parent is None:
            self.report({"ERROR"}, f"{action[PARENT]} is missing: accept the preview instead")
            return {"CANCELLED"}
        if not self.is_accepted:
            preview(context.object, parent)
            bpy.data.actions.remove(action)
            return {"FINISHED"}
        name = action[PARENT]
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


CLASSES = (
    MOGRAFT_OT_next_donor,
    MOGRAFT_OT_choose_donor,
    MOGRAFT_OT_keep_captured,
    MOGRAFT_OT_regenerate,
    MOGRAFT_OT_accept,
    MOGRAFT_OT_show,
)
