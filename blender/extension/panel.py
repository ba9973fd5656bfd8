# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel in the sidebar of the 3D view, tab mograft."""

import bpy

from .change import EDITS, active_graft
from .groups import find_collections
from .sources import PARENT, SETUP


class MOGRAFT_UL_settings(bpy.types.UIList):
    """The actions that give parts, or the conditions."""

    bl_idname = "MOGRAFT_UL_settings"

    def draw_item(self, _context, layout, _data, item, _icon, _active, name):
        """Draw an action with a check box, or the kind and the object of a condition."""
        layout.use_property_split = False
        row = layout.row(align=True)
        if name == "active_condition":
            row.prop(item, "kind", text="", emboss=False)
            if item.kind != "KEEP":
                row.prop(item, "target", text="")
            return
        row.prop(item, "is_used", text="")
        if item.file or item.action:
            icon = "ASSET_MANAGER" if item.file else "ACTION"
            row.label(text=item.name if item.file else item.action.name, icon=icon)
        else:
            row.prop(item, "action", text="")


class MOGRAFT_UL_ranges(bpy.types.UIList):
    """The ranges of a graft."""

    bl_idname = "MOGRAFT_UL_ranges"

    def draw_item(self, _context, layout, _data, item, _icon, _active, _property):
        """Draw frames, group and donor."""
        row = layout.row(align=True)
        row.label(text=f"{item.first}-{item.last} {item.group}")
        row.label(text=item.clip)
        icon = "LOCKED" if item.is_locked else "UNLOCKED"
        row.prop(item, "is_locked", text="", icon=icon, emboss=False)


class _Panel:
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "mograft"

    @classmethod
    def poll(cls, context):
        """Return whether the active object is an armature."""
        return context.object is not None and context.object.type == "ARMATURE"


class MOGRAFT_PT_generate(_Panel, bpy.types.Panel):
    """Sources, parts, and the button."""

    bl_label = "Grafts"

    def draw(self, context):
        """Draw the settings of the armature."""
        layout, settings = self.layout, context.object.mograft
        layout.use_property_split, layout.use_property_decorate = True, False
        layout.label(text="Take parts from:")
        _draw_list(layout, settings, "sources", "active_source")
        row = layout.row(align=True)
        row.operator("mograft.add_sources", icon="ACTION")
        row.operator("mograft.add_assets", text="Assets", icon="ASSET_MANAGER")
        layout.prop(settings, "base")
        found = find_collections(context.object)
        if found:
            layout.prop(settings, "base_group")
            layout.label(text="Bone collections: " + ", ".join(found), icon="GROUP_BONE")
        else:
            layout.prop(settings, "preset")
        layout.operator("mograft.find_groups", icon="GROUP_BONE")
        for name in ("count", "variety", "loop", "seed"):
            layout.prop(settings, name)
        column = layout.column(heading="Options")
        for name in ("is_mirrored", "is_visual", "pushes_down"):
            column.prop(settings, name)
        row = layout.row(align=True)
        row.scale_y = 1.5
        row.operator("mograft.generate", icon="ARMATURE_DATA")
        row.operator("mograft.generate", text="On All").on_all = True


class MOGRAFT_PT_conditions(_Panel, bpy.types.Panel):
    """Constraints."""

    bl_label = "Conditions"
    bl_parent_id = "MOGRAFT_PT_generate"
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012 - as Blender expects

    def draw(self, context):
        """Draw the list, and the selected condition."""
        layout, settings = self.layout, context.object.mograft
        _draw_list(layout, settings, "conditions", "active_condition")
        active = settings.active_condition
        for item in settings.conditions[max(active, 0) : active + 1]:
            if item.kind in ("REACH", "FACE"):
                layout.prop_search(item, "bone", context.object.data, "bones")
            layout.prop(item, "use_frames")
            row = layout.row(align=True)
            for name in ("first", "last") if item.use_frames else ():
                row.prop(item, name)


class MOGRAFT_PT_grafts(_Panel, bpy.types.Panel):
    """The grafts of the armature, and the parts of the one that it shows."""

    bl_label = "Change One Part"

    def draw(self, context):
        """Draw the grafts, and the ranges of the one that is shown."""
        layout, action = self.layout, active_graft(context)
        mark = f'"armature": "{context.object.name}"'
        column = layout.column(align=True)
        for own in bpy.data.actions:
            if PARENT not in own and mark in own.get(SETUP, ""):
                icon = "RADIOBUT_ON" if own == action else "RADIOBUT_OFF"
                label = own.name[-24:]  # the number is at the end
                column.operator("mograft.show", text=label, icon=icon).action = own.name
        if action is None:
            layout.label(text="Show a graft to change its parts")
            return
        layout.label(text=action.get("mograft_newness", ""))
        data = action.mograft
        layout.template_list("MOGRAFT_UL_ranges", "", data, "ranges", data, "active", rows=6)
        for item in data.ranges[max(data.active, 0) : data.active + 1]:
            first, last = (item.donor_start + own for own in (item.donor_first, item.donor_last))
            layout.label(text=f"{item.clip} {first}-{last}")
            layout.label(text=f"cost {item.cost:.2f}, {item.newness:.0f}° from the base")
        grid = layout.grid_flow(columns=2, align=True)
        for kind, label, _ in EDITS:
            grid.operator("mograft.change", text=label).kind = kind
        if PARENT in action:
            row = layout.row(align=True)
            row.operator("mograft.accept", icon="CHECKMARK").is_accepted = True
            row.operator("mograft.accept", text="Discard", icon="X").is_accepted = False
        layout.operator("mograft.repeat")


def _draw_list(layout, settings, name, active):
    row = layout.row()
    row.template_list("MOGRAFT_UL_settings", name, settings, name, settings, active, rows=3)
    column = row.column(align=True)
    for is_added, icon in ((True, "ADD"), (False, "REMOVE")):
        button = column.operator("mograft.edit_list", text="", icon=icon)
        button.name, button.is_added = name, is_added
