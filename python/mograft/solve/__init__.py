"""Search for donor sequences that satisfy constraints on assembled motions."""
