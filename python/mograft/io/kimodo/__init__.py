"""NPZ files of Kimodo: joint positions and rotation matrices in the world."""
