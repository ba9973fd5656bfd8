"""Transplant of donor motion to joint groups of a base: seams, root motion, feet."""
