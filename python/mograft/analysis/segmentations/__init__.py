"""The methods of segmentation, one module each.

A method is added by a module here, named like the method, and one line in
`mograft._util.registry.CONFIG_OPTIONS`. `Config`, `segment`, the command line and the tests of all
methods read them. The extrema of the kinetic energy, "energy", are computed by `segment` itself,
because their parameters are fields of `Config`.
"""

from importlib import import_module

from mograft._util.registry import CONFIG_OPTIONS, Registry
from mograft.analysis.segmentation_method import SegmentationMethod

METHODS: Registry[SegmentationMethod | None] = CONFIG_OPTIONS["segmentation"].implemented_by(
    {
        name: None if name == "energy" else import_module(f"{__name__}.{name}").METHOD
        for name in CONFIG_OPTIONS["segmentation"]
    }
)
