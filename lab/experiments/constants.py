"""Constants of `Config` and of the costs, and the recordings on which they were chosen.

A source on which a constant was chosen is a development source; no conclusion about held-out
recordings rests on it. The values are checked against the program (`tests/lab`).
"""

from dataclasses import dataclass

import mograft as mg
from mograft.blend.trunk_lean import HEADING_SMOOTHING, ROBOT_HEADING_SMOOTHING
from mograft.search.costs import ANGLE_FACTOR, DIVERSE_ANGLE, NOVEL_ANGLE, VELOCITY_FACTOR
from mograft.search.neighbourhoods import FEWEST_DONORS, NEIGHBOURHOODS

DANCES = "salsa, perfume, indian (dance_*)"
LATER = f"{DANCES}, basketball"
DEVELOPMENT = f"{DANCES}, basketball, six clips of Bandai-Namco set 1"
NEWEST = f"{DANCES}, pair dance, six clips of Bandai-Namco set 1"


@dataclass(frozen=True)
class Constant:
    """A constant, what it is in the paper, and the recordings on which it was chosen."""

    name: str
    value: float | str
    paper: str
    chosen_on: str


def _default(name, paper, chosen_on):
    value = getattr(mg.Config(), name)
    return Constant(f"Config.{name}", value, paper, chosen_on)


CONSTANTS = (
    _default("sigma", "eq. 14 as printed (literal)", DANCES),
    _default("sigma_scale", "1", NEWEST),
    _default("length_slack", "none", DANCES),
    _default("min_length", "none", DANCES),
    _default("rotation_floor", "none", DANCES),
    _default("position_floor", "none", DANCES),
    _default("length_floor", "none", DANCES),
    _default("angle_scale", "none", DANCES),
    _default("velocity_scale", "none", DANCES),
    Constant("angle scale / typical angle", ANGLE_FACTOR, "none", DEVELOPMENT),
    Constant("velocity scale / typical velocity gap", VELOCITY_FACTOR, "none", DEVELOPMENT),
    _default("length_weight", "none", DANCES),
    _default("distance_weight", "none", LATER),
    _default("balance_weight", "none", DEVELOPMENT),
    _default("novelty", "none", DEVELOPMENT),
    _default("temperature", "none", DEVELOPMENT),
    _default("diversity", "none", NEWEST),
    _default("seam_blend", "about five frames", DEVELOPMENT),
    Constant("novel pose difference (NOVEL_ANGLE)", NOVEL_ANGLE, "none", LATER),
    Constant("diverse pose difference (DIVERSE_ANGLE)", DIVERSE_ANGLE, "none", LATER),
    Constant("fewest donors (FEWEST_DONORS)", FEWEST_DONORS, "none", LATER),
    Constant("reach of a ball, in radii", NEIGHBOURHOODS["ball"].reach, "none", LATER),
    Constant("seconds over which headings are smoothed", HEADING_SMOOTHING, "none", DEVELOPMENT),
    Constant(
        "the same for robots (seconds)", ROBOT_HEADING_SMOOTHING, "none", "recordings of the G1"
    ),
    _default("loop", "off", "not chosen on results"),
    _default("smoothing", "not stated", "not chosen on results"),
    _default("samples", "10", "the paper"),
    _default("components", "p*", "the paper"),
    _default("max_stretch", "0.15", "the paper"),
    _default("max_angle", "45 degrees", "the paper"),
)
