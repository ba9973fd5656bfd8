// Variations: cards with looping previews, how new they are, and what a person thinks of them.
import { figureOf, ghostOf } from "./figures.js";
import { act, motions, on, select, store } from "./store.js";
import { button, create, field, icon, make, numberInput, percent, selectInput } from "./ui.js";
import { addRegion, dropRegion, isVisible, redraw } from "./view.js";

const PREVIEW_MILLISECONDS = 33; // Between two pictures of the previews.

const cards = new Map(); // Identity of a motion -> its card.
const isStill = matchMedia("(prefers-reduced-motion: reduce)");
const look = { yaw: 0.55, pitch: 0.16, zoom: 1, pan: [0, 0] };
const parts = {};
let clock = 0; // Seconds since the previews began.
let isLooping = !isStill.matches;

const SORTS = {
  made: ["order made", () => 0],
  cost: ["cheapest first", (a, b) => compare(a.cost, b.cost)],
  new: ["newest first", (a, b) => compare(b.new, a.new)],
  apart: ["most unlike those kept", (a, b) => compare(b.apart, a.apart)],
};
const SHOWN = {
  all: ["all", () => true],
  open: ["not rejected", ({ mark }) => mark !== "reject"],
  star: ["with a star", ({ mark }) => mark === "star"],
  kept: ["kept", ({ isKept }) => isKept],
};
// Motions without a number come last.
function compare(a, b) {
  const [has, other] = [a, b].map((value) => value !== null && value !== undefined);
  return has && other ? a - b : other - has;
}

export function startCards() {
  const pane = document.getElementById("pane-motions");
  parts.base = selectInput([], null, { "aria-label": "Base clip" });
  parts.count = numberInput(12, { min: 1, max: 100, step: 1 });
  parts.variety = make("input", { type: "range", min: "0", max: "1", step: "0.05", value: "0.5", "aria-label": "Variety", oninput: () => (parts.variety.dataset.moved = "1") });
  parts.seed = numberInput("", { min: 0, step: 1, placeholder: "next" });
  parts.loop = make("input", { type: "checkbox" });
  parts.swap = make("fieldset", { class: "swap" }, make("legend", { text: "exchange" }));
  parts.make = make("button", { type: "submit", class: "main", text: "Make 12" });
  parts.form = make(
    "form",
    { class: "form", onsubmit: makeMotions },
    field("base", parts.base),
    field("number", parts.count),
    make("div", { class: "scale" }, make("span", { text: "near" }), parts.variety, make("span", { text: "varied" })),
    make("details", {}, make("summary", { text: "seed, loop, groups" }), field("seed", parts.seed), field("loop", parts.loop), parts.swap),
    parts.make,
  );
  parts.count.addEventListener("input", () => (parts.make.textContent = `Make ${parts.count.value || 1}`));
  parts.sort = selectInput(Object.entries(SORTS).map(([key, [text]]) => [key, text]), "made", { onchange: layOut });
  parts.shown = selectInput(Object.entries(SHOWN).map(([key, [text]]) => [key, text]), "all", { onchange: layOut });
  parts.looping = button("Previews", "Play or stop the previews", () => setLooping(!isLooping));
  parts.bar = make("div", { class: "row" }, field("sort", parts.sort), field("show", parts.shown), parts.looping);
  parts.none = make("p", { class: "faint", text: "No motions yet: choose a base, and make some." });
  parts.grid = make("div", { class: "cards", role: "list", "aria-label": "Motions" });
  pane.append(parts.form, parts.bar, parts.none, parts.grid);
  setLooping(isLooping);
  isStill.addEventListener("change", () => setLooping(!isStill.matches));
  on("project", writeAll);
  on("selected", markSelected);
  on("figure", (key) => cards.has(key.slice(7)) && redraw(cards.get(key.slice(7)).region));
  on("theme", layOut);
  setInterval(tick, PREVIEW_MILLISECONDS);
}

function setLooping(isOn) {
  isLooping = isOn;
  parts.looping.setAttribute("aria-pressed", isOn);
}

let before = performance.now();
function tick() {
  const now = performance.now();
  const passed = (now - before) / 1000;
  before = now;
  if (document.hidden || document.getElementById("pane-motions").hidden) return;
  if (isLooping) clock += passed;
  for (const card of cards.values()) {
    if (isLooping || card.isPointed) redraw(card.region);
    if (!isLooping && card.isPointed) clock += passed;
  }
}

function makeMotions(event) {
  event.preventDefault();
  const swap = [...parts.swap.querySelectorAll("input")].filter((own) => own.checked).map((own) => own.value);
  const isAll = swap.length === parts.swap.querySelectorAll("input").length;
  act({
    action: "make",
    base: parts.base.value,
    count: Number(parts.count.value) || 1,
    ...(parts.variety.dataset.moved && { variety: Number(parts.variety.value) }),
    ...(parts.seed.value !== "" && { seed: Number(parts.seed.value) }),
    ...(parts.loop.checked && { loop: true }),
    ...(!isAll && { swap }),
  });
}

function writeForm() {
  const { clips, groups, library } = store.project;
  const names = clips.map(({ name }) => name);
  const key = JSON.stringify([names, groups?.names]);
  if (parts.form.dataset.key !== key) {
    parts.form.dataset.key = key;
    const chosen = parts.base.value;
    parts.base.replaceChildren(...names.map((name) => make("option", { value: name, text: name })));
    if (names.includes(chosen)) parts.base.value = chosen;
    const others = (groups?.names || []).filter((name) => name !== groups.base);
    const boxes = others.map((name) => field(name, make("input", { type: "checkbox", value: name, checked: true })));
    parts.swap.replaceChildren(make("legend", { text: "exchange" }), ...boxes);
  }
  if (!parts.variety.dataset.moved && store.project.options?.variety !== undefined) parts.variety.value = store.project.options.variety;
  parts.make.disabled = library?.status !== "ready" || !names.length;
  parts.make.title = parts.make.disabled ? "Open motions first; the library must be ready" : "";
}

function writeAll() {
  writeForm();
  const all = motions();
  for (const [id, card] of cards) {
    if (all.some((own) => own.id === id)) continue;
    dropRegion(card.region);
    card.element.remove();
    cards.delete(id);
  }
  for (const motion of all) {
    if (!cards.has(motion.id)) cards.set(motion.id, makeCard(motion));
    writeCard(cards.get(motion.id), motion);
  }
  parts.none.hidden = all.length > 0;
  parts.bar.hidden = parts.grid.hidden = all.length === 0;
  layOut();
  markSelected();
}

function makeCard({ id }) {
  const preview = button("", "Show on the stage  Enter", () => select(id), { class: "preview" });
  const name = create("bdi");
  const numbers = create("p", "", "numbers");
  const warning = make("p", { class: "warning", hidden: true });
  const star = button("★", "Star  *", () => toggleMark(id, "star"));
  const reject = button("✕", "Reject  x", () => toggleMark(id, "reject"));
  const more = button("More", "Make more like this", () => act({ action: "more_like", id, count: 4 }));
  const keep = make("input", { type: "checkbox", onchange: () => act({ action: "keep", id, isKept: keep.checked }) });
  const kept = make("label", { class: "keep", title: "Keep: write it on export" }, keep, "Keep");
  const rename = button("✎", "Rename", () => askName(id));
  const head = make("div", { class: "head" }, name, rename);
  const marks = make("div", { class: "marks" }, star, reject);
  const buttons = make("div", { class: "buttons" }, more, kept);
  const element = make("div", { class: "card", role: "listitem" }, preview, marks, head, numbers, warning, buttons);
  const card = { element, preview, name, numbers, warning, star, reject, more, keep, rename, isPointed: false };
  for (const kind of ["pointerenter", "focusin"]) element.addEventListener(kind, () => (card.isPointed = true));
  for (const kind of ["pointerleave", "focusout"]) element.addEventListener(kind, () => (card.isPointed = false));
  element.addEventListener("keydown", (event) => {
    const kind = { "*": "star", x: "reject" }[event.key];
    if (!kind || event.ctrlKey || event.metaKey) return;
    event.stopPropagation();
    toggleMark(id, kind);
  });
  card.region = addRegion(preview, () => {
    if (!isVisible(card.region)) return null;
    const clip = figureOf("motion", id);
    if (!clip) return null;
    const frame = Math.round(clock / clip.dt) % clip.frames;
    return { figures: [{ clip: ghostOf(clip, "card", { rings: 2 }), frame }], look };
  });
  return card;
}

function toggleMark(id, kind) {
  const motion = motions().find((own) => own.id === id);
  act({ action: "mark", id, mark: motion.mark === kind ? null : kind });
}

function askName(id) {
  const card = cards.get(id);
  const motion = motions().find((own) => own.id === id);
  const input = make("input", { type: "text", value: motion.name, "aria-label": "Name of the motion", maxlength: "120" });
  card.name.hidden = card.rename.hidden = true;
  card.name.after(input);
  input.focus();
  input.select();
  const done = (isWanted) => {
    if (!input.isConnected) return;
    const text = input.value.trim();
    card.name.hidden = card.rename.hidden = false;
    input.remove();
    card.rename.focus();
    if (isWanted && text && text !== motion.name) act({ action: "rename", id, name: text });
  };
  input.addEventListener("keydown", (event) => {
    event.stopPropagation();
    if (event.key === "Enter" || event.key === "Escape") done(event.key === "Enter");
  });
  input.addEventListener("blur", () => done(true));
}

// The numbers of a motion, as the reports name them.
export function numbersOf({ cost, new: share, apart }) {
  const texts = [];
  if (share !== null && share !== undefined) texts.push([`${percent(share)} new`, "share of windows that no clip of the library contains"]);
  if (apart !== null && apart !== undefined) texts.push([`${apart.toFixed(0)}° apart`, "angle of the joints to the nearest motion that is kept"]);
  if (cost !== null && cost !== undefined) texts.push([`cost ${cost.toFixed(1)}`, "cost of the donors; less is smoother"]);
  return texts;
}

function writeCard(card, motion) {
  const { name, mark, isKept, violations, isLoop } = motion;
  card.name.textContent = name;
  const texts = [...numbersOf(motion), ...(isLoop ? [["loop", "its end continues its start"]] : [])];
  card.numbers.replaceChildren(...texts.map(([text, title]) => make("span", { text, title })));
  card.element.setAttribute("aria-label", [name, mark === "star" ? "starred" : mark === "reject" ? "rejected" : ""].filter(Boolean).join(", "));
  card.preview.setAttribute("aria-label", `Show ${name} on the stage`);
  for (const [kind, own, text] of [["star", card.star, "Star"], ["reject", card.reject, "Reject"]]) {
    own.setAttribute("aria-pressed", mark === kind);
    own.setAttribute("aria-label", `${text}: ${name}`);
  }
  card.more.setAttribute("aria-label", `More like ${name}`);
  card.rename.setAttribute("aria-label", `Rename ${name}`);
  card.keep.setAttribute("aria-label", `Keep ${name}`);
  card.keep.checked = isKept;
  card.element.classList.toggle("rejected", mark === "reject");
  card.element.classList.toggle("starred", mark === "star");
  card.warning.hidden = !violations.length;
  const text = violations.length === 1 ? "1 violation" : `${violations.length} violations`;
  card.warning.replaceChildren(icon("warn"), text);
}

function layOut() {
  const [, order] = SORTS[parts.sort.value];
  const [, isShown] = SHOWN[parts.shown.value];
  const focused = document.activeElement;
  const sorted = motions().filter(isShown).sort(order);
  const elements = sorted.map(({ id }) => cards.get(id).element);
  if (elements.some((own, i) => parts.grid.children[i] !== own) || parts.grid.children.length !== elements.length) {
    parts.grid.replaceChildren(...elements);
    if (focused?.isConnected && focused !== document.body) focused.focus();
  }
  for (const card of cards.values()) redraw(card.region);
}

function markSelected() {
  for (const [id, card] of cards) {
    card.preview.setAttribute("aria-pressed", id === store.selected);
    card.element.classList.toggle("selected", id === store.selected);
  }
}
