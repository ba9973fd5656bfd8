// The selected frames: what is there, what can be done with them, and the donors that they could have.
import { state } from "/viewer/scene.js";
import { windowOf } from "./figures.js";
import { attempt, send } from "./net.js";
import { mainFigure, player, seek } from "./player.js";
import { redrawStage } from "./stage.js";
import { act, emit, on, selected, store } from "./store.js";
import { lanes, overlaps } from "./timeline.js";
import { button, icon, make, range } from "./ui.js";

const ASK_MILLISECONDS = 120; // A selection that stays this long asks for its donors.
const LIMIT = 24;

const parts = {};
let asked = 0; // Number of the last request for donors.
let listed = ""; // What the donors belong to.
let timer = 0;

export function startSegment() {
  const pane = document.getElementById("pane-segment");
  parts.none = make("p", { class: "faint", text: "Select a block or a range of frames in the timeline." });
  parts.title = make("h3", { text: "" });
  parts.about = make("p", { class: "about" });
  parts.lock = button("Lock", "Changes of other parts keep this one  k", toggleLock);
  parts.other = button("Other part", "The best part of any clip that is new here  n", () => change("change"));
  parts.again = button("Regenerate", "Solve only this range again  r", () => change("regenerate"));
  parts.captured = button("Keep captured", "The captured motion here  b", () => change("restore"));
  parts.ban = button("Ban donor", "Never use the present donor here", () => change("ban"));
  parts.variety = make("input", { type: "range", min: "0", max: "1", step: "0.05", value: "0.5", "aria-label": "Near or varied donors", onchange: () => {
    parts.variety.dataset.moved = "1";
    ask(true);
  } });
  parts.count = make("p", { class: "faint", role: "status" });
  parts.body = make("tbody");
  const heads = ["donor", "cost", "stretch", "seams", ""].map((text) => make("th", { text, scope: "col" }));
  parts.table = make("table", { class: "donors" }, make("caption", { class: "hidden", text: "Possible donors" }), make("thead", {}, make("tr", {}, ...heads)), parts.body);
  parts.more = button("Show more", "More donors", () => ask(true, parts.limit + LIMIT));
  parts.all = make(
    "div",
    { class: "segment", hidden: true },
    parts.title,
    parts.about,
    make("div", { class: "row" }, parts.lock, parts.other, parts.again, parts.captured, parts.ban),
    make("div", { class: "scale" }, make("span", { text: "near" }), parts.variety, make("span", { text: "varied" })),
    parts.count,
    parts.table,
    parts.more,
  );
  pane.append(parts.none, parts.all);
  parts.limit = LIMIT;
  on("focus project selected figure", write);
}

// The variety is that of the project until a person moves the slider.
const varietyOf = () => (parts.variety.dataset.moved ? { variety: Number(parts.variety.value) } : {});
const lockOf = (motion, { group, first, last }) =>
  motion?.locks.find((own) => (own.group === group || own.group === null) && overlaps(own, first, last));

export function toggleLock() {
  const [motion, { focus }] = [selected(), store];
  if (!motion || !focus || focus.isCaptured) return;
  const lock = lockOf(motion, focus);
  if (lock) act({ action: "unlock", id: motion.id, group: lock.group, first: lock.first, last: lock.last });
  else act({ action: "lock", id: motion.id, group: focus.group, first: focus.first, last: focus.last });
}

export async function change(action, donor = {}) {
  const [motion, { focus }] = [selected(), store];
  if (!motion || !focus || focus.isCaptured) return;
  const { group, first, last } = focus;
  const variety = action === "regenerate" ? varietyOf() : {};
  preview(null);
  await act({ action, id: motion.id, group, first, last, ...variety, ...donor });
}

function write() {
  const [motion, { focus }] = [selected(), store];
  const isShown = Boolean(motion && focus);
  parts.none.hidden = isShown;
  parts.all.hidden = !isShown;
  if (!isShown) {
    listed = "";
    preview(null);
    return;
  }
  const where = focus.part === null ? "frames" : `segment ${focus.part}, frames`;
  parts.title.textContent = `${focus.group ?? "All groups"}: ${where} ${range(focus.first, focus.last)}`;
  parts.about.textContent = describe(focus);
  const lock = lockOf(motion, focus);
  parts.lock.replaceChildren(icon("lock"), lock ? "Unlock" : "Lock");
  parts.lock.setAttribute("aria-pressed", Boolean(lock));
  for (const name of ["other", "again", "captured", "ban"]) parts[name].disabled = Boolean(lock) || focus.isCaptured;
  parts.lock.disabled = focus.isCaptured;
  ask();
}

function describe({ group, first, last, isCaptured }) {
  if (isCaptured) return "The base keeps this group: it is captured motion.";
  const lane = lanes().find(({ row }) => row.group === group);
  if (!lane) return "";
  const { row, clip } = lane;
  const texts = [];
  for (let part = 0; part < row.start.length && texts.length < 4; part++) {
    const [a, b] = [row.start[part], row.stop[part]];
    if (b <= first || a >= last) continue;
    if (row.source[part] < 0) texts.push(`${range(a, b)} captured`);
    else {
      const stretch = Math.abs(row.stretch[part]) < 0.0005 ? "" : `, ${(100 * row.stretch[part]).toFixed(0)} % longer`.replace(/-(\d+ %) longer/, "$1 shorter");
      texts.push(`${range(a, b)} from ${clip.donors[row.source[part]]} ${range(row.first[part], row.last[part])}${stretch}`);
    }
    const seam = row.before[part];
    if (seam !== null) texts.push(`${texts.pop()}, seam ${seam.toFixed(1)}°`);
  }
  for (const own of row.changes)
    if (own.stop >= first && own.start <= last) texts.push(`changed in ${range(own.start, own.stop)}: ${clip.donors[own.source]} ${range(own.first, own.last)}`);
  return texts.join(" · ");
}

function ask(isForced = false, limit = LIMIT) {
  const [motion, { focus }] = [selected(), store];
  if (focus.isCaptured || focus.group === null || focus.isDragging) {
    parts.body.replaceChildren();
    parts.count.textContent = focus.group === null ? "Donors are listed for the frames of one group." : "";
    parts.more.hidden = parts.table.hidden = true;
    listed = "";
    return;
  }
  const key = JSON.stringify([motion.id, motion.hash, motion.locks, focus.group, focus.first, focus.last, store.project.library?.segments]);
  if (key === listed && !isForced) return;
  listed = key;
  parts.limit = limit;
  clearTimeout(timer);
  const number = ++asked;
  timer = setTimeout(async () => {
    const { group, first, last } = focus;
    const body = { id: motion.id, group, first, last, limit, ...varietyOf() };
    parts.count.textContent = "Donors are compared…";
    const found = await attempt(() => send("/api/donors", body));
    if (number !== asked) return;
    if (!found) {
      parts.count.textContent = "";
      parts.body.replaceChildren();
      return;
    }
    writeDonors(found, focus, lockOf(motion, focus));
  }, ASK_MILLISECONDS);
}

function writeDonors({ donors, total }, focus, lock) {
  const isFocused = parts.body.contains(document.activeElement);
  const number = isFocused ? [...parts.body.children].findIndex((own) => own.contains(document.activeElement)) : -1;
  parts.body.replaceChildren(...donors.map((own) => donorRow(own, focus, lock)));
  if (number >= 0) parts.body.children[Math.min(number, donors.length - 1)]?.querySelector("button")?.focus();
  const allowed = donors.filter(({ refused }) => !refused).length;
  parts.count.textContent = `${allowed} of ${total} possible donors${lock ? "; locked: unlock to change" : ""}. Point at one to see it in place.`;
  parts.table.hidden = !donors.length;
  parts.more.hidden = donors.length >= total || donors.length < parts.limit;
}

const number = (value, digits) => (value === null || value === undefined ? "" : value.toFixed(digits));

function donorRow(own, focus, lock) {
  const { clip, first, last, refused, isUsed } = own;
  const name = `${clip} ${range(first, last)}`;
  const donor = { clip, from: first, to: last };
  const take = button("Take", refused ? `Refused: ${refused}` : "Use this donor here", () => change("take", donor), { "aria-label": `Take ${name}` });
  take.disabled = Boolean(refused) || Boolean(lock) || isUsed;
  const see = button(name, "Show in place", () => preview(own), { class: "plain" });
  const row = make(
    "tr",
    { class: refused ? "refused" : isUsed ? "used" : "" },
    make("td", {}, see, isUsed ? make("span", { class: "tag", text: "in use" }) : null, refused ? make("span", { class: "why", text: refused }) : null),
    make("td", { text: number(own.cost, 1) }),
    make("td", { text: own.stretch === null || own.stretch === undefined ? "" : `${own.stretch > 0 ? "+" : ""}${(100 * own.stretch).toFixed(0)} %` }),
    make("td", { text: own.seamBefore === null || own.seamBefore === undefined ? "" : `${number(own.seamBefore, 0)}°/${number(own.seamAfter, 0)}°` }),
    make("td", {}, take),
  );
  for (const kind of ["pointerenter", "focusin"]) row.addEventListener(kind, () => preview(own, focus));
  for (const kind of ["pointerleave", "focusout"]) row.addEventListener(kind, () => preview(null));
  return row;
}

let previewed = 0;
// Pose a donor in place: its group moves as the donor until null is given.
async function preview(own, focus = store.focus) {
  const turn = ++previewed;
  if (state.preview) {
    state.preview = null;
    emit("preview");
    redrawStage();
  }
  const clip = mainFigure();
  if (!own || !focus || !clip) return;
  const frames = await attempt(() => windowOf(own.clip, own.first, own.last));
  if (turn !== previewed || !frames) return;
  const index = clip.groups.indexOf(focus.group);
  const joints = clip.parents.flatMap((_, joint) => (clip.group[joint] === index ? [joint] : []));
  state.preview = { clip, joints, start: focus.first, stop: focus.last, first: own.first, last: own.last, frames };
  if (player.frame < focus.first || player.frame > focus.last) seek((focus.first + focus.last) / 2);
  emit("preview");
  redrawStage();
}
