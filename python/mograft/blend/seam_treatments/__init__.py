"""The seam treatments by name: one module for each value of `Config.seam`.

To add a treatment, write a module in this folder that holds one object ``TREATMENT``, a
`mograft.blend.seams.SeamTreatment`, and name it here and in the annotation of `Config.seam`.
"""

from mograft.blend.seam_treatments import displacement, gradient, inertial, offset, paper
from mograft.blend.seams import SeamTreatment

SEAM_TREATMENTS: dict[str, SeamTreatment] = {
    "gradient": gradient.TREATMENT,
    "offset": offset.TREATMENT,
    "paper": paper.TREATMENT,
    "displacement": displacement.TREATMENT,
    "inertial": inertial.TREATMENT,
}
"""The treatment of each value of `Config.seam`."""
