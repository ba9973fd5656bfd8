"""The seam treatments by name: one module for each value of `Config.seam`.

To add a treatment ``NAME``, write a module ``NAME.py`` in this folder that holds one object
``TREATMENT``, a `mograft.blend.seams.SeamTreatment`, and one line for it in
`mograft._util.registry.CONFIG_OPTIONS`. `Config`, the command line and the tests of all treatments
read that line.
"""

from importlib import import_module

from mograft._util.registry import CONFIG_OPTIONS, Registry
from mograft.blend.seams import SeamTreatment

SEAM_TREATMENTS: Registry[SeamTreatment] = CONFIG_OPTIONS["seam"].implemented_by(
    {name: import_module(f"{__name__}.{name}").TREATMENT for name in CONFIG_OPTIONS["seam"]}
)
"""The treatment of each value of `Config.seam`."""
