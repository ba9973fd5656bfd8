"""Rotations, resampling, skeletons and motions."""
