"""The page of a study, and the key that says what its numbers stand for."""

import hashlib
import hmac
import html
import json
import secrets
from pathlib import Path

import numpy as np

from lab.pairs.excerpts import CAPTURED, CHECK, TARGET
from mograft.viewing.figure import Figure
from mograft.viewing.page import assemble_page, asset, embed_json, viewer_html, viewer_script
from mograft.viewing.scene import Scene

RESULT_FORMAT, KEY_FORMAT = "mograft.pairs/1", "mograft.pairs.key/1"
_HERE = Path(__file__).parent


def build_study(excerpts, arms, contact, seed=0, secret=None):
    """Return the page of a study, and its key.

    Each participant sees every excerpt once: one of as many sets of pairs as there are arms, in
    which an excerpt is in one arm. The sets together have every excerpt in every arm. The page
    numbers motions and pairs in random order and names no arm; the key does. `secret` is the text
    by which results are signed; by default it is random.
    """
    rng = np.random.default_rng(seed)
    places = [(k, name) for k, own in enumerate(excerpts) for name in own.motions]
    order = rng.permutation(len(places))
    number = {places[place]: i for i, place in enumerate(order.tolist())}
    items = [
        {"excerpt": k, "arm": arm, "target": number[k, TARGET], "other": number[k, arm]}
        for k in range(len(excerpts))
        for arm in arms
    ]
    items += [
        {"excerpt": k, "arm": CHECK, "target": number[k, CAPTURED], "other": number[k, CHECK]}
        for k, own in enumerate(excerpts)
        if CHECK in own.motions
    ]
    items = [items[i] for i in rng.permutation(len(items)).tolist()]
    sets = [
        [
            i
            for i, own in enumerate(items)
            if own["arm"] == CHECK or own["arm"] == arms[(own["excerpt"] + k) % len(arms)]
        ]
        for k in range(len(arms))
    ]
    motions = [excerpts[k].motions[name] for k, name in (places[place] for place in order)]
    secret = secret or secrets.token_hex(16)
    texts = [motion.rotations.tobytes() for motion in motions]
    study = hashlib.sha256(b"".join(texts) + secret.encode()).hexdigest()[:12]
    sources = [{"source": o.source, "clip": o.clip, "start": o.start} for o in excerpts]
    key = {"format": KEY_FORMAT, "study": study, "secret": secret, "arms": list(arms)}
    key |= {"items": items, "sets": sets, "excerpts": sources}
    data = {"format": RESULT_FORMAT, "study": study, "secret": secret, "sets": sets}
    data |= {"items": [sorted((own["target"], own["other"])) for own in items]}
    data |= {"milliseconds": round(1000 * motions[0].n_frames * motions[0].frame_time)}
    return _page(motions, data, contact), key


def _page(motions, data, contact):
    joints = [np.arange(motion.n_joints) for motion in motions]
    figures = (
        Figure(motion=motion, name="", members={"body": own}, rows=())
        for motion, own in zip(motions, joints, strict=True)
    )
    text = {name: (_HERE / f"study.{name}").read_text(encoding="utf-8") for name in _FILES}
    n_trials = len(data["sets"][0])
    body = (
        text["html"].replace("{trials}", str(n_trials)).replace("{contact}", html.escape(contact))
    )
    minutes = -(-n_trials * (data["milliseconds"] + 4000) // 60_000)
    body = body.replace("{minutes}", f"{minutes} minute{'s'[: minutes != 1]}")
    body = body.replace("{viewer}", viewer_html(Scene(tuple(figures)), n_shown=2))
    body += embed_json(data, "study-data")
    scripts = "\n".join((asset("three.js"), viewer_script(), text["js"]))
    return assemble_page("Which motion looks more natural?", body, "study", text["css"], scripts)


_FILES = ("html", "css", "js")


def canonical(result):
    """Return the bytes of a result that are signed: those of JSON.stringify in the page."""
    return json.dumps(result, separators=(",", ":"), ensure_ascii=False).encode()


def sign(result, secret):
    """Return a result with its signature, as the page writes it.

    The signature shows that a page of the study wrote the result and that nothing was changed by
    accident. It does not show who judged, and whoever reads the page can make one.
    """
    digest = hmac.new(secret.encode(), canonical(result), hashlib.sha256).hexdigest()
    return {"result": result, "signature": digest}
