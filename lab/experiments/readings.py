"""How much the readings of what the paper does not state decide.

All combinations of: the frame of the angular velocities of the energy; the coordinates of the
rotations, which are rotation vectors or the Euler angles of the file, unwrapped within a segment;
the number of principal components; eq. 14 as printed or as root mean square. The rest is
`Config.paper()`. Cuts in common: share of the cuts of the first reading within a frame of a cut.
Pairs in common: those in one cluster of the base with both this reading and the first one with the
same segments and eq. 14, divided by those with either. κ is that of `matched`, with the clusters
of all segments. Intervals resample blocks.
"""

import itertools
from dataclasses import dataclass, replace

import numpy as np

import mograft as mg
from lab.donors.compatibility import compatibility
from lab.donors.methods import cluster_candidates
from lab.experiments.tables import Table, format_estimate
from mograft.clustering import cut, threshold
from mograft.evaluation import Method, RandomLength

NAME = "readings"
SOURCES = ("salsa A", "salsa B")
FRAMES = ("world", "local")
COORDINATES = ("rotation vector", "Euler")
COMPONENTS = (10, 20)
SIGMAS = ("literal", "rms")
N_GRAFTS = 5
MIN_KAPPA = 30  # segments with a donor, below which a table has no κ


@dataclass(frozen=True, eq=False)
class Clusters(Method):
    """Method with the donors of similar length in given clusters."""

    name: str = "clusters"
    labels: np.ndarray | None = None

    def candidates(self, library, scenario):
        """Return the candidates for base segments; see `Method.candidates`."""
        return cluster_candidates(library, scenario, self.labels)


def measure(recordings, *, is_quick):
    """Return the measures of every reading of a source."""
    found, cuts, pairs = [], None, {}
    readings = itertools.product(FRAMES, COORDINATES, COMPONENTS, SIGMAS)
    for omega, coordinates, components, sigma in readings:
        config = mg.Config.paper(omega=omega, components=components, sigma=sigma)
        library = recordings.build(config)
        if coordinates == "Euler":
            library = _with_euler_angles(library)
        labels = library.labels[library.groups.base]
        cuts = _cuts(library) if cuts is None else cuts
        is_pair = np.triu(labels[:, None] == labels, 1)
        first = pairs.setdefault((omega, sigma), is_pair)
        near = [np.abs(own - other).min(axis=1) <= 1 for own, other in _both(cuts, library)]
        found.append(
            {
                "reading": [omega, coordinates, components, sigma],
                "segments": len(labels),
                "cuts": float(np.mean(np.concatenate(near))),
                "pairs": float((is_pair & first).sum() / max((is_pair | first).sum(), 1)),
                "n_pairs": int(is_pair.sum()),
                "kappa": _kappa(library, labels),
                "exchanged": _exchanged(library, 1 if is_quick else N_GRAFTS),
            }
        )
    return found


def _cuts(library):
    segments = library.segments
    return [segments.start[segments.clip == k] for k in range(len(library.clips))]


def _both(cuts, library):
    """Yield for each clip the given cuts, as a column, and those of the library."""
    for own, other in zip(cuts, _cuts(library), strict=True):
        yield own[:, None], other


def _with_euler_angles(library):
    """Return the library with clusters by Euler angles for rotation vectors."""
    samples, labels, sigma = library.samples, {}, {}
    turns = np.asarray(samples.rotations, np.float64)
    rest = np.asarray(samples.displacements_and_length, np.float64)
    for group, known in library.embedding.items():
        angles = [
            _euler_angles(turns[:, :, joint], library.skeleton.rotation_order(joint))
            for joint in known.joints.tolist()
        ]
        columns = [own.reshape(len(samples), -1) for own in angles]
        columns.append(rest if known.has_root else rest[:, -1:])
        points = _components(np.concatenate(columns, axis=1), library.config.components)
        sigma[group] = threshold(points, library.config.sigma, library.config.sigma_scale)
        labels[group] = cut(points, sigma[group])
    return replace(library, labels=labels, sigma=sigma)


def _euler_angles(quats, order):
    """Return the angles of shape (n_segments, n_samples, 3), unwrapped within each segment."""
    flat = quats.reshape(-1, 4)
    flat = flat / np.linalg.norm(flat, axis=1, keepdims=True)
    return np.unwrap(mg.rotations.to_euler(flat, order).reshape(*quats.shape[:2], 3), axis=1)


def _components(rows, n):
    """Return the first principal components of the correlation matrix."""
    deviation = rows.std(axis=0, ddof=1)
    kept = deviation > 1e-6
    scores = (rows[:, kept] - rows[:, kept].mean(axis=0)) / deviation[kept]
    return scores @ np.linalg.svd(scores, full_matrices=False)[2][:n].T


def _kappa(library, labels):
    try:
        found = compatibility(library, methods=(RandomLength(), Clusters(labels=labels)), splits=2)
    except mg.InsufficientDataError:
        return None
    return found.scores[1].matched.as_dict()


def _exchanged(library, count):
    """Return the least and the largest share of exchanged segments of several grafts."""
    grafts = mg.graft_many(library, count=count, seed=0)
    shares = [sum(not own.is_own for own in graft.substitutions) for graft in grafts]
    return [min(shares), max(shares), len(grafts[0].substitutions)]


def tables(results):
    """All readings, and what grafts of the two presets exchange."""
    rows, exchanges = [], []
    for name, found in results.items():
        for own in found:
            low, high, n = own["exchanged"]
            is_known = own["kappa"] is not None and own["kappa"]["n"] >= MIN_KAPPA
            kappa = format_estimate(own["kappa"], 2) if is_known else "-"
            rows.append(
                (
                    name,
                    *map(str, own["reading"]),
                    str(own["segments"]),
                    f"{100 * own['cuts']:.0f} %",
                    f"{100 * own['pairs']:.0f} %",
                    str(own["n_pairs"]),
                    kappa,
                    f"{100 * low / n:.0f}",
                    f"{100 * high / n:.0f}",
                )
            )
            if own["reading"][:3] == [FRAMES[0], COORDINATES[0], COMPONENTS[0]]:
                preset = "paper" if own["reading"][3] == "literal" else "paper-rms"
                exchanges.append((name, preset, str(n), str(low), str(high)))
    head = ("energy", "coordinates", "components", "eq. 14", "segments", "cuts in common")
    head += ("pairs in common", "pairs", "matched κ", "least exchanged", "most exchanged")
    counts = ("source", "preset", "segments", "least exchanged", "most exchanged")
    return {"all": Table(("source", *head), rows), "exchanges": Table(counts, exchanges)}
