# SPDX-License-Identifier: GPL-3.0-or-later
"""mograft in Blender: new actions that take body parts from other actions."""

import bpy

from . import change, grafting, operators, panel, properties

_MODULES = (operators, change, panel)
_CLASSES = [
    own
    for module in _MODULES
    for own in vars(module).values()
    if getattr(own, "__module__", "") == module.__name__ and own.__name__.startswith("MOGRAFT_")
]


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
