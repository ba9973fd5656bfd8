"""`GraftRequest`: what was requested of a graft."""

from dataclasses import dataclass
from typing import Literal

from mograft.scenario import Scenario
from mograft.search.constraints import Constraint


@dataclass(frozen=True, kw_only=True, eq=False)
class GraftRequest:
    """The arguments of `mograft.graft` or `mograft.repair` that led to a graft.

    Attributes
    ----------
    method : {"graft", "repair"}
        The function.
    base : str or None
        The name of the base; None for the first clip or a scenario.
    swap : tuple of str or None
        The groups to exchange; None for all but the base group.
    constraints : tuple of Constraint
        The constraints. They give base segments and donors by their frames, not by number.
    scenario : Scenario or None
        The base, if it is composed of segments.
    command : str or None
        The command line, as typed; None in Python.
    sources : tuple of str
        The files, folders or library that the command line names.
    edit_commands : tuple of str or None
        The command line of each later edit; None in Python.
    """

    method: Literal["graft", "repair"] = "graft"
    base: str | None = None
    swap: tuple[str, ...] | None = None
    constraints: tuple[Constraint, ...] = ()
    scenario: Scenario | None = None
    command: str | None = None
    sources: tuple[str, ...] = ()
    edit_commands: tuple[str | None, ...] = ()
