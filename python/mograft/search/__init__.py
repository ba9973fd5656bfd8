"""Candidates, costs, constraints and the search over donor sequences."""
