"""Checks of the Blender extension in several versions of Blender."""
