"""Compare rules of donor selection on motions of one's own, as the paper does.

``python -m lab compare FILE... [--only TOPIC...] [-o FOLDER]`` prints, for the clips of the files
or of one library: the possible combinations (5.4), the compatibility of the parts (5.3), and the
quality, detectability and balance (5.5) of grafts by each rule; ``-o`` writes the numbers to
``comparison.json`` and figures.
"""

import argparse
import json
from pathlib import Path

import mograft as mg
from lab import plots
from lab.common import tiny_motion
from lab.donors.compatibility import compatibility
from lab.donors.enrichment import cluster_numbers, enrichment, moment_laws, sweep
from lab.donors.methods import default_methods, makers
from lab.donors.retrieval import retrieval
from mograft import evaluation

TOPICS = ("combinations", "compatibility", "retrieval", "quality", "detectability", "balance")


def compare(library, topics=TOPICS, *, runs=4, seed=0):
    """Return the results of all rules as values for JSON, and the figures by name."""
    found, figures = {}, {}
    methods = default_methods(library)
    if "combinations" in topics:
        counts, scales = enrichment(library), sweep(library)
        laws = moment_laws(counts.segments, {c.groups: c.unfiltered for c in counts.counts})
        found["combinations"] = counts.as_dict() | {
            "clusters": cluster_numbers(library),
            "sweep": [own.as_dict() for own in scales],
            "laws": [own.as_dict() for own in laws],
        }
        figures["combinations"] = plots.draw_counts({"scales": scales})
    # Changes of the configuration alter the motions, but not the pairs of parts.
    selecting = [method for method in methods if not method.config_changes]
    groups = [name for name in library.groups.names if name != library.groups.base]
    for name, measure in (
        ("compatibility", lambda group: compatibility(library, group, selecting, seed=seed)),
        ("retrieval", lambda group: retrieval(library, group, seed=seed)),
    ):
        if name in topics:
            measured = {group: _refused(measure, group) for group in groups}
            found[name] = {
                group: own if isinstance(own, str) else own.as_dict()
                for group, own in measured.items()
            }
            kappas = {g: own for g, own in measured.items() if hasattr(own, "auc")}
            if kappas:
                figures[name] = plots.draw_kappa(kappas)
    chosen = [topic for topic in ("quality", "detectability", "balance") if topic in topics]
    if chosen:
        grafts = evaluation.evaluate(
            library, chosen, methods=methods and makers(methods), runs=runs, seed=seed
        )
        found |= {topic: [row.as_dict() for row in getattr(grafts, topic)] for topic in chosen}
        found["refused"] = dict(grafts.refusals)
        draw = {"quality": plots.draw_quality, "detectability": plots.draw_detectability}
        figures |= {
            topic: draw[topic](getattr(grafts, topic))
            for topic in chosen
            if topic in draw and getattr(grafts, topic)
        }
    return found, figures


def _refused(measure, group):
    try:
        return measure(group)
    except mg.InsufficientDataError as error:
        return str(error)


def main(argv=None):
    """Print or write the comparison."""
    parser = argparse.ArgumentParser(prog="lab compare", description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", help="motion files, or one library")
    parser.add_argument("--only", nargs="+", choices=TOPICS, default=TOPICS)
    parser.add_argument("--preset", choices=("default", "paper", "paper-rms"), default="default")
    parser.add_argument("--runs", type=int, default=4, help="grafts of each base and rule")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help="a few seconds of the dancer")
    parser.add_argument("-o", "--output", type=Path, help="folder of comparison.json and figures")
    options = parser.parse_args(argv)
    if not options.files and not options.quick:
        parser.error("expected one library or at least one motion file, got none")
    sigma = "literal" if options.preset == "paper" else "rms"
    config = mg.Config() if options.preset == "default" else mg.Config.paper(sigma=sigma)
    if options.quick:
        library = mg.Library.build([tiny_motion(1, 400), tiny_motion(2, 400)], config=config)
    elif Path(options.files[0]).is_dir():
        library = mg.Library.open(options.files[0])
    else:
        library = mg.Library.build(
            [clip for path in options.files for clip in mg.read(path)], config=config
        )
    found, figures = compare(library, options.only, runs=options.runs, seed=options.seed)
    text = json.dumps(found, indent=1)
    if options.output is None:
        print(text)
        return
    options.output.mkdir(parents=True, exist_ok=True)
    (options.output / "comparison.json").write_text(text + "\n", encoding="utf-8")
    for name, figure in figures.items():
        (options.output / f"{name}.svg").write_text(plots.as_svg(figure), encoding="utf-8")
