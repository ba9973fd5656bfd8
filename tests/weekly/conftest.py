"""Fixtures of grafting."""

from tests.grafting_fixtures import make_problem, make_wall, root_library, short_base, two_dances  # noqa: F401

collect_ignore = ["blender/inside.py"]  # Blender imports it
