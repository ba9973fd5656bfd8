"""Sequences of base segments, and the graph of transitions that they follow."""

from mograft.scenario.transition_graph import Transitions, transitions
from mograft.scenario.walks import Scenario, fill, follow, to_beats, walk

__all__ = ["Scenario", "Transitions", "fill", "follow", "to_beats", "transitions", "walk"]
