"""Simulated participants: they test the analysis, and give its power before anybody judges."""

import numpy as np

from lab.pairs.analysis import draw_weights, resampled_shares
from lab.pairs.excerpts import CHECK

RATER_DEVIATION, EXCERPT_DEVIATION = 0.5, 0.8
"""Standard deviations of the preference between people and between excerpts, in log odds."""


def simulate_choices(shape, share, rng):
    """Return whether each participant prefers the graft of each excerpt.

    The log odds are normal around a value at which the mean probability is about `share`.
    """
    rater = rng.normal(0, RATER_DEVIATION, (shape[0], 1))
    excerpt = rng.normal(0, EXCERPT_DEVIATION, (1, shape[1]))
    # The mean of a logistic function of a normal variable (MacKay 1992).
    spread = np.sqrt(1 + np.pi / 8 * (RATER_DEVIATION**2 + EXCERPT_DEVIATION**2))
    odds = spread * np.log(share / (1 - share)) + rater + excerpt
    return rng.random(shape) < 1 / (1 + np.exp(-odds))


def simulate_results(key, shares, n_raters, rng, p_check=1.0):
    """Return the results of simulated participants; `shares` maps arms to preferences."""
    items, sets = key["items"], key["sets"]
    shape = (n_raters, len(key["excerpts"]))
    choices = {arm: simulate_choices(shape, shares[arm], rng) for arm in key["arms"]}
    results = []
    for rater in range(n_raters):
        trials = []
        for index in rng.permutation(sets[rater % len(sets)]).tolist():
            item = items[index]
            is_target = rng.random() < p_check
            if item["arm"] != CHECK:
                is_target = choices[item["arm"]][rater, item["excerpt"]]
            pair = [item["target"], item["other"]]
            trial = {"item": index, "left": pair[int(rng.integers(2))]}
            trials.append(trial | {"chosen": pair[1 - int(is_target)], "milliseconds": 5000})
        start = {"format": "mograft.pairs/1", "study": key["study"], "participant": f"{rater:032x}"}
        results.append(start | {"set": rater % len(sets), "window": "", "trials": trials})
    return results


def power(share, n_raters, n_excerpts, n_arms=3, n_studies=400, seed=0):
    """Return in which share of simulated studies the 95 % interval of an arm excludes one half."""
    rng = np.random.default_rng(seed)
    shape = (n_raters, n_excerpts)
    weights = draw_weights(shape, seed + 1)
    arm = (np.arange(n_excerpts) + np.arange(n_raters)[:, None]) % n_arms
    shown = (arm == 0).astype(float)
    found = 0
    for _ in range(n_studies):
        preferred = shown * simulate_choices(shape, share, rng)
        low, high = np.percentile(resampled_shares(shown, preferred, weights), [2.5, 97.5])
        found += low > 0.5 or high < 0.5
    return found / n_studies
