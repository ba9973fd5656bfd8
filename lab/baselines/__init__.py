"""Generators of motions that a reader may use instead of grafts."""
