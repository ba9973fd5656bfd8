# SPDX-License-Identifier: GPL-3.0-or-later
"""What the file stores: the settings of an armature, and the ranges of a graft."""

import bpy
from bpy import props

from .curves import find_curves
from .grafting import VARIETIES
from .groups import PRESETS
from .scene_constraints import KINDS


def _is_armature(_self, item):
    return item.type == "ARMATURE"


def _is_base(self, action):
    return action.library is None and bool(find_curves(action, self.id_data))


WORDS = [own[:3] for own in VARIETIES]
PARTS = [*((own, own.replace("_", ", "), "") for own in PRESETS), ("auto", "found in motion", "")]


class MograftSource(bpy.types.PropertyGroup):
    """An action that gives parts."""

    action: props.PointerProperty(type=bpy.types.Action)
    armature: props.PointerProperty(type=bpy.types.Object, poll=_is_armature)
    file: props.StringProperty(description="The .blend file of an action of an asset library")
    is_used: props.BoolProperty(name="Use", default=True, description="Take parts of this action")


class MograftCondition(bpy.types.PropertyGroup):
    """A constraint on grafts."""

    kind: props.EnumProperty(name="Condition", items=KINDS)
    target: props.PointerProperty(name="Object", type=bpy.types.Object)
    bone: props.StringProperty(name="Bone")
    use_frames: props.BoolProperty(name="Only in frames", description="Else in all frames")
    first: props.IntProperty(name="First", default=1)
    last: props.IntProperty(name="Last", default=30)


class MograftRange(bpy.types.PropertyGroup):
    """A range of frames that a graft takes from another action."""

    group: props.StringProperty()
    first: props.IntProperty()
    last: props.IntProperty()
    clip: props.StringProperty()
    donor_first: props.IntProperty()
    donor_last: props.IntProperty()
    donor_start: props.IntProperty(description="First frame of the donor action in its own time")
    cost: props.FloatProperty(description="Lower is more similar")
    newness: props.FloatProperty(description="Mean difference from the base in degrees")
    is_locked: props.BoolProperty(name="Lock", description="Regenerate keeps these frames")


def _go_to_range(self, context):
    for own in self.ranges[max(self.active, 0) : self.active + 1]:
        context.scene.frame_set(own.first)


class MograftAction(bpy.types.PropertyGroup):
    """What the panel shows of a graft."""

    ranges: props.CollectionProperty(type=MograftRange)
    active: props.IntProperty(update=_go_to_range)


class MograftSettings(bpy.types.PropertyGroup):
    """The settings of an armature."""

    sources: props.CollectionProperty(type=MograftSource)
    active_source: props.IntProperty()
    base: props.PointerProperty(
        name="Base",
        type=bpy.types.Action,
        poll=_is_base,
        description="Its legs and path stay. Without a choice: the action of the armature",
    )
    preset: props.EnumProperty(
        name="Parts",
        items=PARTS,
        description="The parts of the body that are kept or exchanged as a whole",
    )
    base_group: props.StringProperty(name="Kept part", default="lower")
    count: props.IntProperty(name="Number", default=3, min=1, max=1000)
    seed: props.IntProperty(name="Seed", min=0, description="Another seed gives other grafts")
    variety: props.EnumProperty(name="Variety", items=WORDS, default="MEDIUM")
    loop: props.EnumProperty(
        name="Loop",
        items=(("auto", "As the base", ""), ("on", "Always", ""), ("off", "Never", "")),
        description="Whether the last frame meets the first",
    )
    is_mirrored: props.BoolProperty(name="Mirrored, too", description="Also take mirror images")
    is_visual: props.BoolProperty(
        name="Visual",
        description="Read deform bones as constraints move them; grafts turn the constraints off",
    )
    pushes_down: props.BoolProperty(name="NLA tracks", description="Add a muted track for each")
    conditions: props.CollectionProperty(type=MograftCondition)
    active_condition: props.IntProperty()


CLASSES = (MograftSource, MograftCondition, MograftRange, MograftAction, MograftSettings)


def register():
    """Register the classes and attach them."""
    for own in CLASSES:
        bpy.utils.register_class(own)
    bpy.types.Object.mograft = props.PointerProperty(type=MograftSettings)
    bpy.types.Action.mograft = props.PointerProperty(type=MograftAction)


def unregister():
    """Undo `register`."""
    del bpy.types.Object.mograft, bpy.types.Action.mograft
    for own in reversed(CLASSES):
        bpy.utils.unregister_class(own)
