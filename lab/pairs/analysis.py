"""The analysis of the results of a study, fixed before anybody has judged.

For each arm the share of judgements that prefer the graft. Its 95 % interval is that of a bootstrap
that draws participants and excerpts (Owen, Annals of Applied Statistics 1, 2007), so that it covers
other people and other excerpts. It is too wide: without a preference, about one in a hundred arms
shows one. A preference is an interval that excludes one half. Grafts and the other motions are
equally natural if the 90 % interval lies within `MARGIN` of one half (two one-sided tests). There
are no intervals below `MIN_RATERS` participants. Agreement is Krippendorff's alpha of the choices
between the same two motions.
"""

import hmac
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lab.pairs.excerpts import CHECK
from lab.pairs.study import KEY_FORMAT, RESULT_FORMAT, sign

MARGIN = 0.1
MIN_RATERS = 10
MAX_MISSED_CHECKS = 1
MIN_SHARE = 0.5
"""Share of the pairs of a set that a participant must have judged."""
N_RESAMPLES = 2000


@dataclass(frozen=True, eq=False)
class Judgements:
    """Choices by participant and excerpt in one arm."""

    arm: str
    shown: np.ndarray  # how often the participant judged the excerpt, (n_raters, n_excerpts)
    preferred: np.ndarray  # how often they preferred the graft


@dataclass(frozen=True)
class Preference:
    """The share of judgements that prefer the graft; intervals are None with few participants."""

    arm: str
    share: float
    n: int
    interval: tuple | None  # of 95 %
    equivalence: tuple | None  # of 90 %
    alpha: float
    verdict: str


def read_key(path):
    """Read the key of a study."""
    key = _read(path)
    if not isinstance(key, dict) or key.get("format") != KEY_FORMAT:
        raise ValueError(f"{path}: expected the key of a study, {KEY_FORMAT}")
    return key


def read_results(paths, key):
    """Return the judgements by arm, and the excluded files with reasons."""
    results, excluded, seen = [], [], set()
    for path in sorted(map(Path, paths)):
        try:
            result = _check(_read(path), key)
            if result["participant"] in seen:
                raise ValueError("this participant has an earlier file")
        except ValueError as error:
            excluded.append((path.name, str(error)))
            continue
        seen.add(result["participant"])
        results.append(result)
    return count_judgements([own["trials"] for own in results], key), excluded


def count_judgements(trials, key):
    """Return the judgements by arm of the trials of several participants."""
    items, shape = key["items"], (len(trials), len(key["excerpts"]))
    found = {arm: Judgements(arm, np.zeros(shape), np.zeros(shape)) for arm in key["arms"]}
    for rater, own in enumerate(trials):
        for trial in own:
            item = items[trial["item"]]
            if item["arm"] != CHECK:
                judged = found[item["arm"]]
                judged.shown[rater, item["excerpt"]] += 1
                judged.preferred[rater, item["excerpt"]] += trial["chosen"] == item["target"]
    return found


def _read(path):
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path}: expected JSON, {error}") from error


def _check(signed, key):
    """Return the result of a file; raise ValueError with the reason to exclude it."""
    if not isinstance(signed, dict) or not isinstance(signed.get("result"), dict):
        raise ValueError("the file is not a result")
    result = signed["result"]
    if (result.get("format"), result.get("study")) != (RESULT_FORMAT, key["study"]):
        raise ValueError("the result is of another study")
    expected = sign(result, key["secret"])["signature"]
    if not hmac.compare_digest(expected, str(signed.get("signature"))):
        raise ValueError("the result was changed: its signature does not match")
    shown, trials = set(key["sets"][result["set"]]), result["trials"]
    judged = [trial["item"] for trial in trials]
    if len(set(judged)) < len(judged) or not set(judged) <= shown:
        raise ValueError("the result has pairs that are not those of its set, once each")
    missed = [
        key["items"][trial["item"]]["target"] != trial["chosen"]
        for trial in trials
        if key["items"][trial["item"]]["arm"] == CHECK
    ]
    if len(trials) < MIN_SHARE * len(shown):
        raise ValueError(f"{len(trials)} of {len(shown)} pairs are judged")
    if sum(missed) > MAX_MISSED_CHECKS:
        raise ValueError(f"{sum(missed)} of {len(missed)} attention checks are missed")
    return result


def prefer(judgements, seed=0):
    """Return the `Preference` of an arm."""
    shown, preferred = judgements.shown, judgements.preferred
    n = int(shown.sum())
    if not n:
        return Preference(judgements.arm, np.nan, 0, None, None, np.nan, "no judgements")
    share, interval, equivalence = float(preferred.sum() / n), None, None
    verdict = f"fewer than {MIN_RATERS} participants"
    if (shown.sum(axis=1) > 0).sum() >= MIN_RATERS:
        shares = resampled_shares(shown, preferred, draw_weights(shown.shape, seed))
        low, below, above, high = np.nanpercentile(shares, [2.5, 5, 95, 97.5]).tolist()
        interval, equivalence = (low, high), (below, above)
        verdict = "undecided"
        if below > 0.5 - MARGIN and above < 0.5 + MARGIN:
            verdict = "equally natural"
        if low > 0.5 or high < 0.5:
            verdict = "graft preferred" if low > 0.5 else "graft not preferred"
    alpha = krippendorff_alpha(preferred, shown)
    return Preference(judgements.arm, share, n, interval, equivalence, alpha, verdict)


def draw_weights(shape, seed, n=N_RESAMPLES):
    """Return how often resamples draw each participant and each excerpt."""
    rng = np.random.default_rng(seed)
    return [rng.multinomial(size, np.full(size, 1 / size), n).astype(float) for size in shape]


def resampled_shares(shown, preferred, weights):
    """Return the share of preferred grafts in every resample."""
    raters, excerpts = weights
    hits, total = (((raters @ own) * excerpts).sum(axis=1) for own in (preferred, shown))
    return np.divide(hits, total, out=np.full(len(hits), np.nan), where=total > 0)


def krippendorff_alpha(preferred, shown):
    """Return Krippendorff's alpha of choices; NaN if no two people judged the same excerpt.

    It is 1 if all choices between the same motions are equal, and 0 if they agree by chance.
    """
    yes, n = preferred.sum(axis=0), shown.sum(axis=0)
    yes, n = yes[n > 1], n[n > 1]
    total, total_yes = n.sum(), yes.sum()
    if not total:
        return np.nan
    observed = (2 * yes * (n - yes) / np.maximum(n - 1, 1)).sum() / total
    expected = 2 * total_yes * (total - total_yes) / (total * (total - 1))
    return 1.0 if expected == 0 else float(1 - observed / expected)
