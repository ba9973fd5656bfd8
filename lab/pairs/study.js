"use strict";
(() => {
  const data = JSON.parse(document.getElementById("study-data").textContent);
  const get = (id) => document.getElementById(id);
  const show = (step) => {
    for (const section of document.querySelectorAll("[data-step]")) section.hidden = section.dataset.step !== step;
  };
  const random = new Uint32Array(4);
  crypto.getRandomValues(random);
  const result = {
    format: data.format,
    study: data.study,
    participant: [...random].map((own) => own.toString(16).padStart(8, "0")).join(""),
    set: random[0] % data.sets.length,
    window: "",
    trials: [],
  };
  const choices = [get("choose-0"), get("choose-1")];
  const order = shuffle(data.sets[result.set]);
  let sides = null; // The motions at the left and at the right, while a choice is possible.
  let shownAt = 0;

  function shuffle(values) {
    const found = [...values];
    const draws = crypto.getRandomValues(new Uint32Array(found.length));
    for (let i = found.length - 1; i > 0; i--) {
      const k = draws[i] % (i + 1);
      [found[i], found[k]] = [found[k], found[i]];
    }
    return found;
  }

  function enable(isOn) {
    for (const button of choices) button.disabled = !isOn;
  }

  async function next() {
    const at = result.trials.length;
    if (at === order.length) return finish();
    enable(false);
    get("progress").textContent = `Pair ${at + 1} of ${order.length}`;
    const pair = shuffle(data.items[order[at]]);
    const { scene, state } = mograft;
    pair.forEach((motion, side) => (scene.clips[motion].name = side ? "2" : "1"));
    Object.assign(state, { yaw: 0.55, pitch: 0.22, zoom: 1, pan: [0, 0], colours: false });
    await mograft.show(pair);
    mograft.seek(0);
    if (!state.playing) document.querySelector('[data-part="play"]').click();
    shownAt = performance.now();
    // Both motions are seen once before a choice.
    setTimeout(() => {
      sides = pair;
      enable(true);
    }, data.milliseconds);
  }

  function choose(side) {
    if (!sides) return;
    const [left] = sides;
    const milliseconds = Math.round(performance.now() - shownAt);
    result.trials.push({ item: order[result.trials.length], left, chosen: sides[side], milliseconds });
    sides = null;
    next();
  }

  async function finish() {
    sides = null;
    mograft.state.playing = false;
    result.window = `${innerWidth}x${innerHeight}`;
    const encode = (text) => new TextEncoder().encode(text);
    const key = await crypto.subtle.importKey("raw", encode(data.secret), { name: "HMAC", hash: "SHA-256" }, false, ["sign"]);
    const bytes = new Uint8Array(await crypto.subtle.sign("HMAC", key, encode(JSON.stringify(result))));
    const signature = [...bytes].map((own) => own.toString(16).padStart(2, "0")).join("");
    const text = JSON.stringify({ result, signature });
    get("participant").textContent = result.participant;
    get("text").value = text;
    get("save").href = URL.createObjectURL(new Blob([text], { type: "application/json" }));
    get("save").download = `pairs-${result.participant.slice(0, 8)}.json`;
    show("end");
  }

  get("agree").addEventListener("change", (event) => (get("start").disabled = !event.target.checked));
  get("start").addEventListener("click", () => {
    show("trial");
    next();
  });
  get("stop").addEventListener("click", finish);
  choices.forEach((button, side) => button.addEventListener("click", () => choose(side)));
  document.addEventListener("keydown", (event) => {
    if (!event.repeat && (event.key === "1" || event.key === "2")) choose(Number(event.key) - 1);
  });
  // A reload would lose the choices.
  addEventListener("beforeunload", (event) => {
    if (result.trials.length && !get("save").href) event.preventDefault();
  });
})();
