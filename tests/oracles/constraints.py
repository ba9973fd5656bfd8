"""How far candidates violate constraints, from the poses of every candidate."""

import numpy as np

from mograft.solve.assembly import assemble
from mograft.solve.donor_trellis import candidate_poses


def candidate_amounts(problem, group, chosen):
    """Return for each position the hard violation amounts and soft costs of all candidates."""
    context = assemble(problem, chosen) if chosen else problem.base
    joints = problem.driven_joints[group]
    found = []
    for position, donors in enumerate(problem.candidates[group]):
        poses = candidate_poses(problem, group, np.full(len(donors), position), donors, context)
        hard, soft = np.zeros(len(donors)), problem.origin_costs(group)[position]
        for constraint in problem.pose_constraints:
            errors = constraint.errors(poses, joints)[0].reshape(len(donors), -1).max(axis=1)
            if constraint.is_hard:
                hard = np.maximum(hard, errors)
            else:
                soft = soft + constraint.weight * errors**2
        found.append((hard, soft))
    return found
