# SPDX-License-Identifier: GPL-3.0-or-later
"""mograft in Blender: new actions that take body parts from other actions."""
