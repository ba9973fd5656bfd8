# SPDX-License-Identifier: GPL-3.0-or-later
"""What the file stores: the settings of an armature, and the ranges of a graft."""

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from .curves import find_curves
from .grafting import VARIETIES
from .groups import PRESETS
from .scene_constraints import KINDS
from .sources import RECORD


def _is_armature(_self, item):
    return item.type == "ARMATURE"


def _is_base(self, action):
    return action.library is None and bool(find_curves(action, self.id_data))


class MograftSource(bpy.types.PropertyGroup):
    """An action that gives parts."""

    action: PointerProperty(type=bpy.types.Action)
    armature: PointerProperty(type=bpy.types.Object, poll=_is_armature)
    file: StringProperty(description="The .blend file of an action of an asset library")
    is_used: BoolProperty(name="Use", default=True, description="Take parts of this action")


class MograftCondition(bpy.types.PropertyGroup):
    """A constraint on grafts."""

    kind: EnumProperty(name="Condition", items=KINDS)
    target: PointerProperty(name="Object", type=bpy.types.Object)
    bone: StringProperty(name="Bone")
    use_frames: BoolProperty(name="Only in frames", description="Else in all frames")
    first: IntProperty(name="First", default=1)
    last: IntProperty(name="Last", default=30)


class MograftRange(bpy.types.PropertyGroup):
    """A range of frames that a graft takes from another action."""

    group: StringProperty()
    first: IntProperty()
    last: IntProperty()
    clip: StringProperty()
    donor_first: IntProperty()
    donor_last: IntProperty()
    donor_start: IntProperty(description="First frame of the donor action in its own time")
    cost: FloatProperty(description="Lower is more similar")
    newness: FloatProperty(description="Mean difference from the base in degrees")
    is_locked: BoolProperty(name="Lock", description="Regenerate leaves these frames as they are")


def _go_to_range(self, context):
    if 0 <= self.active < len(self.ranges):
        context.scene.frame_set(self.ranges[self.active].first)


class MograftAction(bpy.types.PropertyGroup):
    """What the panel shows of a graft."""

    ranges: CollectionProperty(type=MograftRange)
    active: IntProperty(update=_go_to_range)


class MograftSettings(bpy.types.PropertyGroup):
    """The settings of an armature."""

    sources: CollectionProperty(type=MograftSource)
    active_source: IntProperty()
    base: PointerProperty(
        name="Base",
        type=bpy.types.Action,
        poll=_is_base,
        description="Its legs and path stay. Without a choice: the action of the armature",
    )
    preset: EnumProperty(
        name="Parts",
        items=[(own, own.replace("_", ", "), "") for own in PRESETS]
        + [("auto", "found in the motion", "Groups of bones that move together")],
        description="The parts of the body that are kept or exchanged as a whole",
    )
    base_group: StringProperty(
        name="Kept part", default="lower", description="The part that stays as in the base"
    )
    count: IntProperty(name="Number", default=3, min=1, max=1000, description="Number of grafts")
    seed: IntProperty(name="Seed", min=0, description="Another seed gives other grafts")
    variety: EnumProperty(name="Variety", items=[own[:3] for own in VARIETIES], default="MEDIUM")
    loop: EnumProperty(
        name="Loop",
        items=(
            ("auto", "As the base", "The graft is a loop if the base is one"),
            ("on", "Always", "The last frame meets the first"),
            ("off", "Never", "The ends need not meet"),
        ),
    )
    is_mirrored: BoolProperty(
        name="Mirrored, too", description="Also take mirror images of the sources"
    )
    is_visual: BoolProperty(
        name="Visual",
        description="Sample the deform bones as constraints and drivers move them (slower). New "
        "actions turn off the constraints of the bones that they key",
    )
    pushes_down: BoolProperty(
        name="NLA tracks", description="Add a muted track for each graft to the NLA"
    )
    conditions: CollectionProperty(type=MograftCondition)
    active_condition: IntProperty()


CLASSES = (MograftSource, MograftCondition, MograftRange, MograftAction, MograftSettings)


def register():
    """Register the classes and attach them."""
    for own in CLASSES:
        bpy.utils.register_class(own)
    bpy.types.Object.mograft = PointerProperty(type=MograftSettings)
    bpy.types.Action.mograft = PointerProperty(type=MograftAction)


def unregister():
    """Undo `register`."""
    del bpy.types.Object.mograft, bpy.types.Action.mograft
    for own in reversed(CLASSES):
        bpy.utils.unregister_class(own)


def is_graft(action):
    """Return whether an action is a graft."""
    return action is not None and RECORD in action
