"""Robots: models in MJCF and URDF, and motions as their joint angles."""
