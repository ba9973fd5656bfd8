"""``python -m lab [SECTION] ...``: run a section of the laboratory.

Without one, measure everything that is not stored, and draw the figures.
"""

import importlib
import os
import sys
import warnings

SECTIONS = {
    "experiments": "lab.experiments.run",
    "compare": "lab.studies.compare",
    "copies": "lab.studies.copies",
    "figures": "lab.figures",
    "delays": "lab.studies.delays",
    "feet": "lab.studies.feet",
    "groups": "lab.studies.groups",
    "neighbourhoods": "lab.studies.neighbourhoods",
    "seams": "lab.studies.seams",
    "variety": "lab.studies.variety",
}


def main(argv=None):
    """Run the section that the first argument names with the arguments behind it."""
    arguments = sys.argv[1:] if argv is None else argv
    if not arguments or arguments[0].startswith("--"):
        main(["experiments", *arguments])
        is_elsewhere = {"--quick", "-o", "--output"} & set(arguments)
        return None if is_elsewhere else main(["figures"])
    if arguments[0] not in SECTIONS:
        names = ", ".join(SECTIONS)
        return f"usage: python -m lab [SECTION] [--help] ...; SECTION is one of {names}"
    warnings.simplefilter("ignore")
    return importlib.import_module(SECTIONS[arguments[0]]).main(arguments[1:])


if __name__ == "__main__":
    # Before NumPy is imported: the threads of OpenMP wait for each other longer than they compute.
    os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"
    sys.exit(main())
