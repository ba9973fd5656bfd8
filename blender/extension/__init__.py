# SPDX-License-Identifier: GPL-3.0-or-later
"""mograft in Blender: new actions that take body parts from other actions."""

import bpy

from . import change, grafting, operators, panel, properties

_CLASSES = (*operators.CLASSES, *change.CLASSES, *panel.CLASSES)


def register():
    """Add operators, properties and panels."""
    properties.register()
    for own in _CLASSES:
        bpy.utils.register_class(own)


def unregister():
    """Remove them, and the library that is kept in memory."""
    for own in reversed(_CLASSES):
        bpy.utils.unregister_class(own)
    properties.unregister()
    grafting.forget()
