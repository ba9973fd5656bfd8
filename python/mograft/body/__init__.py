"""What a skeleton and its motion say about the body: joint names, groups, masses, contacts."""
