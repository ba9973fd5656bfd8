"""The body of a skeleton: parts, joint groups, masses, foot contacts and recording faults."""
