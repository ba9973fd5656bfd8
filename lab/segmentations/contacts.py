"""Cut frames at the events of the feet: touchdown and lift-off."""

from dataclasses import dataclass

import numpy as np

from mograft.body.contacts import detect_contacts


@dataclass(frozen=True)
class ContactParameters:
    """Parameters of the method "contacts".

    Parameters
    ----------
    events : {"both", "touchdown", "liftoff"}
        Which events of a foot are cut frames. A touchdown is the first frame of a contact, a
        lift-off the first frame after it.
    """

    events: str = "both"


def cut_frames(motion, parameters):
    """Return the frames in which a foot starts or stops touching the floor.

    A foot touches the floor if its heel or toe does, as `detect_contacts` defines. Raises
    ValueError if the skeleton has no legs.
    """
    contacts = detect_contacts(motion).any(axis=2)
    if not contacts.shape[1]:
        raise ValueError(
            "`segmentation` 'contacts' needs a skeleton with legs, "
            f"{motion.name or 'the motion'} has none"
        )
    changes = np.diff(contacts.astype(np.int8), axis=0)
    wanted = {"both": changes != 0, "touchdown": changes > 0, "liftoff": changes < 0}
    return np.flatnonzero(wanted[parameters.events].any(axis=1)) + 1
