"""Actions of a person on a project."""
