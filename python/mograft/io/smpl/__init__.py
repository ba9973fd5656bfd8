"""AMASS files: motions of the body models SMPL, SMPL-H and SMPL-X."""
