"""The values that a parameter accepts, and the object behind each.

This module imports neither NumPy nor other modules of the package, so that the command line can
list the values without loading them. Modules attach objects with `Registry.implemented_by`.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

from mograft.errors import suggest_name

T = TypeVar("T")
S = TypeVar("S")


@dataclass(frozen=True, eq=False)
class Registry(Generic[T]):
    """The accepted values of one parameter, in documented order, and an object for each value."""

    parameter: str  # its name, for messages
    entries: Mapping[str, T]  # the object of each accepted value

    def __iter__(self) -> Iterator[str]:
        return iter(self.entries)

    def __len__(self) -> int:
        return len(self.entries)

    @property
    def names(self) -> tuple[str, ...]:
        """The accepted values."""
        return tuple(self.entries)

    def get(self, name: object) -> T:
        """Return the object for the value `name`; raise ValueError if the value is not accepted."""
        if isinstance(name, str) and name in self.entries:
            return self.entries[name]
        accepted = ", ".join(map(repr, self.entries))
        hint = suggest_name(name, self.entries)
        raise ValueError(f"`{self.parameter}` must be one of {accepted}, got {name!r}{hint}")

    def implemented_by(self, implementations: Mapping[str, S]) -> "Registry[S]":
        """Return a registry with the same accepted values and the objects in `implementations`.

        Raises ValueError unless the keys of `implementations` are exactly the accepted values.
        """
        if set(implementations) != set(self.entries):
            raise ValueError(
                f"`{self.parameter}` needs implementations of {', '.join(self.entries)}, "
                f"got {', '.join(implementations)}"
            )
        return Registry(self.parameter, {name: implementations[name] for name in self.entries})


_DESCRIPTIONS = {
    "segmentation": {
        "energy": "extrema of the kinetic energy, as in the paper",
    },
    "omega": {
        "world": "angular velocities relative to the world",
        "local": "angular velocities relative to the parent joint",
    },
    "inertia": {
        "own": "moment of inertia of the link alone",
        "subtree": "moment of inertia of the link and of all links below it",
        "unit": "moment of inertia 1 for every link",
    },
    "sigma": {
        "rms": "root mean square distance of the segments from their mean",
        "literal": "square root of the mean distance, as the paper prints it",
    },
    "neighbourhood": {
        "cluster": "the base segment's cluster, as in the paper",
        "ball": "all segments within a radius of the base segment",
    },
    "choice": {
        "viterbi": "minimum total cost; in further motions, repeated donors cost more",
        "best": "the motions of the lowest total costs",
        "sample": "drawn with probability exp(-cost / temperature)",
        "nearest": "most similar base segments; seams only have to satisfy the limit",
        "random": "uniform among the donors within the limits, as in the paper",
    },
    "seam": {
        "gradient": "frames on both sides that best keep the donors' accelerations",
        "offset": "a decaying offset on both sides; continuous pose and velocity",
        "paper": "displacement over the segments, then a cubic through the seam window",
        "displacement": "the pose gap spread over both segments",
        "inertial": "a decaying offset after the seam only",
    },
    "alignment": {
        "uniform": "donors stretched at a constant rate",
        "dtw": "donors stretched by dynamic time warping of the base parts",
    },
    "torso": {
        "pelvis": "a grafted trunk keeps its angle to the pelvis",
        "world": "a grafted trunk keeps its lean in the world, with the heading of the base",
        "balanced": "as world, and the trunk also balances the sway of the base's pelvis",
    },
    "feet": {
        "auto": "feet planted unless the base group holds both legs and root",
        "never": "feet left as the graft places them",
    },
}
CONFIG_OPTIONS = {name: Registry(name, entries) for name, entries in _DESCRIPTIONS.items()}
"""For every parameter of `Config` that selects by name: the accepted values, each described."""
