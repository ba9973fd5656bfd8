"""Scenarios: sequences of base segments, their transition graph, and walks on bent paths."""

from mograft.scenario.bending import bend
from mograft.scenario.path_following import follow
from mograft.scenario.scenario import Repetition, Scenario, repetition
from mograft.scenario.transition_graph import Transitions, transitions
from mograft.scenario.walks import fill, to_beats, walk

__all__ = [
    "Repetition",
    "Scenario",
    "Transitions",
    "bend",
    "fill",
    "follow",
    "repetition",
    "to_beats",
    "transitions",
    "walk",
]
