"""Fixtures of grafting."""

from tests.grafting_fixtures import (  # noqa: F401
    make_problem,
    make_wall,
    root_library,
    short_base,
    two_dances,
)
