"""Placing donor parts on a base motion: transplant, seams, root motion, feet."""
