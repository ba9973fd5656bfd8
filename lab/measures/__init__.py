"""Measures of sets of motions, with which generators are compared."""
