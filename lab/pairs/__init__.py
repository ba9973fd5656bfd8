"""A study in which people choose the more natural of two motions, and its analysis."""
