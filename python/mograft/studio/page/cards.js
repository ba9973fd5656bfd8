// Variations: cards with looping previews, how new they are, and what a person thinks of them.
import { figureOf, ghostOf } from "./figures.js";
import { act, motions, on, select, store } from "./store.js";
import { countViolated } from "./records.js";
import { breakable, button, counted, create, field, fill, icon, make, parts, percent } from "./ui.js";
import { addRegion, dropRegion, isVisible, redraw } from "./view.js";

const PREVIEW_MILLISECONDS = 33; // Between two pictures of the previews.

const cards = new Map(); // Identity of a motion -> its card.
const isStill = matchMedia("(prefers-reduced-motion: reduce)");
const look = { yaw: 0.55, pitch: 0.16, zoom: 1, pan: [0, 0] };
let clock = 0; // Seconds since the previews began.
let isLooping = !isStill.matches;

const SORTS = {
  made: () => 0,
  cost: (a, b) => compare(a.cost, b.cost),
  new: (a, b) => compare(b.new, a.new),
  apart: (a, b) => compare(b.apart, a.apart),
};
const SHOWN = {
  all: () => true,
  open: ({ mark }) => mark !== "reject",
  star: ({ mark }) => mark === "star",
  kept: ({ isKept }) => isKept,
};
// Motions without a number come last.
function compare(a, b) {
  const [has, other] = [a, b].map((value) => value !== null && value !== undefined);
  return has && other ? a - b : other - has;
}

export function startCards() {
  parts.makeForm.addEventListener("submit", makeMotions);
  parts.makeVariety.addEventListener("input", () => (parts.makeVariety.dataset.moved = "1"));
  parts.makeCount.addEventListener("input", () => (parts.make.textContent = `Make ${counted(Number(parts.makeCount.value) || 1, "motion")}`));
  for (const own of [parts.sort, parts.shown]) own.addEventListener("change", layOut);
  parts.previews.addEventListener("click", () => setLooping(!isLooping));
  parts.removeRejected.addEventListener("click", () => act({ action: "remove", ids: rejected().map(({ id }) => id) }));
  parts.makeBase.addEventListener("change", () => {
    store.clip = parts.makeBase.value;
    select(null);
  });
  setLooping(isLooping);
  isStill.addEventListener("change", () => setLooping(!isStill.matches));
  on("project", writeAll);
  on("selected", markSelected);
  on("figure", (key) => cards.has(key.slice(7)) && redraw(cards.get(key.slice(7)).region));
  setInterval(tick, PREVIEW_MILLISECONDS);
}

const rejected = () => motions().filter(({ mark }) => mark === "reject");

function setLooping(isOn) {
  isLooping = isOn;
  parts.previews.setAttribute("aria-pressed", isOn);
  parts.previews.textContent = isOn ? "Stop previews" : "Play previews";
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

async function makeMotions(event) {
  event.preventDefault();
  const swap = [...parts.makeSwap.querySelectorAll("input")].filter((own) => own.checked).map((own) => own.value);
  const isAll = swap.length === parts.makeSwap.querySelectorAll("input").length;
  const reply = await act({
    action: "make",
    base: parts.makeBase.value,
    count: Number(parts.makeCount.value) || 1,
    ...(parts.makeVariety.dataset.moved && { variety: Number(parts.makeVariety.value) }),
    ...(parts.makeSeed.value !== "" && { seed: Number(parts.makeSeed.value) }),
    ...(parts.makeLoop.checked && { loop: true }),
    ...(!isAll && { swap }),
  });
  if (reply?.motions.length) select(reply.motions[0]);
}

function writeForm() {
  const { clips, groups, library } = store.project;
  const names = clips.map(({ name }) => name);
  const key = JSON.stringify([names, groups?.names]);
  if (parts.makeForm.dataset.key !== key) {
    parts.makeForm.dataset.key = key;
    const chosen = parts.makeBase.value;
    fill(parts.makeBase, names, names.includes(chosen) ? chosen : names[0]);
    const others = (groups?.names || []).filter((name) => name !== groups.base);
    const boxes = others.map((name) => field(name, make("input", { type: "checkbox", value: name, checked: true })));
    parts.makeSwap.replaceChildren(...boxes);
  }
  if (!parts.makeVariety.dataset.moved && store.project.options?.variety !== undefined)
    parts.makeVariety.value = store.project.options.variety;
  const base = groups?.base ? `the path and the group “${groups.base}”` : "the path and the legs";
  parts.makeHint.textContent = `New motions keep ${base} of the base motion. Their other joint groups come from other clips.`;
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
  parts.removeRejected.hidden = !rejected().length;
  parts.removeRejected.textContent = `Delete ${rejected().length} rejected`;
  parts.noCards.hidden = all.length > 0;
  parts.cardsBar.hidden = parts.cards.hidden = all.length === 0;
  layOut();
  markSelected();
}

function makeCard({ id }) {
  const preview = button("", "Show on the stage  Enter", () => select(id), { class: "preview" });
  const name = create("bdi");
  const numbers = create("p", "", "numbers");
  const warning = make("p", { class: "warning", hidden: true });
  const star = button("Favourite", "Mark as a favourite, for you alone  *", () => toggleMark(id, "star"));
  const reject = button("Reject", "Mark as rejected  x", () => toggleMark(id, "reject"));
  const more = button("More like this", "Make 4 similar motions", () => act({ action: "more_like", id, count: 4 }));
  const keep = make("input", { type: "checkbox", onchange: () => act({ action: "keep", id, isKept: keep.checked }) });
  const kept = make("label", { class: "keep", title: "Export writes the motions with this tick" }, keep, "Keep for export");
  const rename = button("Rename", "Change the name", () => askName(id));
  const buttons = make("div", { class: "buttons" }, star, reject, more, rename, kept);
  const element = make("div", { class: "card", role: "listitem" }, preview, name, numbers, warning, buttons);
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
  card.name.hidden = true;
  card.name.after(input);
  input.focus();
  input.select();
  const done = (isWanted) => {
    if (!input.isConnected) return;
    const text = input.value.trim();
    card.name.hidden = false;
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

// The numbers of a motion, as the reports name them; those that are known.
function numbersOf({ cost, new: share, apart, isLoop }) {
  const isKnown = (value) => value !== null && value !== undefined;
  const costs = motions().flatMap((own) => (isKnown(own.cost) ? [own.cost] : []));
  const rank = costs.filter((own) => own < cost).length + 1;
  const texts = [
    isKnown(share) && [`${percent(share)} new`, "share of windows that no clip of the library contains"],
    isKnown(apart) && [`${apart.toFixed(0)}° from kept`, "angle of the joints to the nearest motion that is kept"],
    isKnown(cost) && [`fit ${rank} of ${costs.length}`, "place by the cost of its parts; 1 fits best"],
    isLoop && ["loops", "its end continues its start"],
  ];
  return texts.filter(Boolean).map(([text, title]) => make("span", { text, title }));
}

function writeCard(card, motion) {
  const { name, mark, isKept, violations } = motion;
  card.name.replaceChildren(...breakable(name));
  card.numbers.replaceChildren(...numbersOf(motion));
  const marked = { star: ", favourite", reject: ", rejected" }[mark] || "";
  card.element.setAttribute("aria-label", name + marked);
  card.preview.setAttribute("aria-label", `Show ${name} on the stage`);
  for (const kind of ["star", "reject"]) card[kind].setAttribute("aria-pressed", mark === kind);
  for (const own of [card.star, card.reject, card.more, card.rename]) own.ariaLabel = `${own.textContent}: ${name}`;
  card.keep.ariaLabel = `Keep for export: ${name}`;
  card.keep.checked = isKept;
  card.element.classList.toggle("rejected", mark === "reject");
  card.element.classList.toggle("starred", mark === "star");
  card.warning.hidden = !violations.length;
  card.warning.replaceChildren(icon("warn"), `${countViolated(motion)} violated`);
  card.warning.title = "Constraints that are violated";
}

function layOut() {
  const focused = document.activeElement;
  const sorted = motions().filter(SHOWN[parts.shown.value]).sort(SORTS[parts.sort.value]);
  const elements = sorted.map(({ id }) => cards.get(id).element);
  if (elements.some((own, i) => parts.cards.children[i] !== own) || parts.cards.children.length !== elements.length) {
    parts.cards.replaceChildren(...elements);
    if (focused?.isConnected && focused !== document.body) focused.focus();
  }
  // All are drawn again if one of them has moved.
  if (sorted.length) redraw(cards.get(sorted[0].id).region);
}

function markSelected() {
  for (const [id, card] of cards) {
    card.preview.setAttribute("aria-pressed", id === store.selected);
    card.element.classList.toggle("selected", id === store.selected);
  }
}
