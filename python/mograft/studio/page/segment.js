// The selected frames: what is there, what can be done with them, and the donors that they could have.
import { state } from "/viewer/scene.js";
import { windowOf } from "./figures.js";
import { attempt, send } from "./net.js";
import { mainFigure, player, seek } from "./player.js";
import { redrawStage } from "./stage.js";
import { act, emit, on, selected, store } from "./store.js";
import { lanes, overlaps } from "./timeline.js";
import { breakable, button, icon, make, parts, range } from "./ui.js";

const ASK_MILLISECONDS = 120; // A selection that stays this long asks for its donors.
const LIMIT = 24;
const BUTTONS = { other: "change", again: "regenerate", captured: "restore", ban: "ban" };

let asked = 0; // Number of the last request for donors.
let listed = ""; // What the donors belong to.
let timer = 0;
let limit = LIMIT; // Number of donors that are asked for.

export function startSegment() {
  parts.lock.addEventListener("click", toggleLock);
  for (const [name, action] of Object.entries(BUTTONS)) parts[name].addEventListener("click", () => change(action));
  parts.donorVariety.addEventListener("change", () => {
    parts.donorVariety.dataset.moved = "1";
    ask(true);
  });
  parts.moreDonors.addEventListener("click", () => ask(true, limit + LIMIT));
  on("focus project selected figure", write);
}

// The variety is that of the project until a person moves the slider.
const varietyOf = () => (parts.donorVariety.dataset.moved ? { variety: Number(parts.donorVariety.value) } : {});
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
  parts.noSegment.hidden = isShown;
  parts.segment.hidden = !isShown;
  if (!isShown) {
    forget();
    preview(null);
    return;
  }
  const where = focus.part === null ? "frames" : `segment ${focus.part}, frames`;
  parts.segmentTitle.textContent = `${focus.group ?? "All groups"}: ${where} ${range(focus.first, focus.last)}`;
  parts.segmentText.textContent = describe(focus);
  const lock = lockOf(motion, focus);
  parts.lock.replaceChildren(icon("lock"), lock ? "Unlock" : "Lock");
  parts.lock.setAttribute("aria-pressed", Boolean(lock));
  for (const name of Object.keys(BUTTONS)) parts[name].disabled = Boolean(lock) || focus.isCaptured;
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
    if (row.source[part] < 0) texts.push(`${range(a, b)} captured with the base motion`);
    else {
      const share = Math.round(100 * row.stretch[part]);
      const stretch = share ? `, ${Math.abs(share)} % ${share > 0 ? "longer" : "shorter"}` : "";
      texts.push(`${range(a, b)} from ${clip.donors[row.source[part]]} ${range(row.first[part], row.last[part])}${stretch}`);
    }
    const seam = row.before[part];
    if (seam !== null) texts.push(`${texts.pop()}, seam ${seam.toFixed(1)}°`);
  }
  for (const own of row.changes)
    if (own.stop >= first && own.start <= last)
      texts.push(`changed in ${range(own.start, own.stop)}: ${clip.donors[own.source]} ${range(own.first, own.last)}`);
  return texts.join(" · ");
}

// An answer that is on its way belongs to another selection.
function forget() {
  clearTimeout(timer);
  asked++;
  listed = "";
}

function ask(isForced = false, wanted = LIMIT) {
  const [motion, { focus }] = [selected(), store];
  if (focus.isCaptured || focus.group === null || focus.isDragging) {
    parts.donorRows.replaceChildren();
    parts.donorCount.textContent = focus.group === null ? "Parts are listed for the frames of one joint group." : "";
    parts.moreDonors.hidden = parts.donors.hidden = true;
    forget();
    return;
  }
  const { group, first, last } = focus;
  const key = JSON.stringify([motion.id, motion.hash, motion.locks, group, first, last, store.project.library?.segments]);
  if (key === listed && !isForced) return;
  [listed, limit] = [key, wanted];
  clearTimeout(timer);
  parts.donorRows.setAttribute("aria-busy", true); // What is listed belongs to another selection.
  const number = ++asked;
  timer = setTimeout(async () => {
    const body = { id: motion.id, group, first, last, limit, ...varietyOf() };
    parts.donorCount.textContent = "Parts are compared…";
    const found = await attempt(() => send("/api/donors", body));
    if (number !== asked) return;
    if (!found) {
      parts.donorCount.textContent = "";
      parts.donorRows.replaceChildren();
      return;
    }
    if (found.superseded) listed = ""; // by another window of the browser
    else writeDonors(found, focus, lockOf(motion, focus));
  }, ASK_MILLISECONDS);
}

function writeDonors({ donors, total }, focus, lock) {
  const place = [...parts.donorRows.querySelectorAll("button")].indexOf(document.activeElement); // Two in a row.
  parts.donorRows.replaceChildren(...donors.map((own) => donorRow(own, focus, lock)));
  parts.donorRows.removeAttribute("aria-busy");
  const row = parts.donorRows.children[Math.min(place >> 1, donors.length - 1)];
  for (const own of [0, place & 1]) row?.querySelectorAll("button")[own]?.focus(); // The first if the other is disabled.
  const allowed = donors.filter(({ refused }) => !refused).length;
  const what = lock ? "Locked: unlock to change." : "Point at one to see it on the figure; Use exchanges it.";
  parts.donorCount.textContent = `${allowed} of ${total} can be used. ${what}`;
  parts.donors.hidden = !donors.length;
  parts.moreDonors.hidden = donors.length >= total || donors.length < limit;
}

const refusalOf = (text) => text.replace(/length: \S+ is (not below|above) \S+/, "too long or too short").replace("seam: ", "jump of ");
// A cell with a number, empty if it is unknown.
const cell = (value, show) => make("td", { text: value === null || value === undefined ? "" : show(value) });

function donorRow(own, focus, lock) {
  const { clip, first, last, refused, isUsed, seamAfter } = own;
  const name = `${clip} ${range(first, last)}`;
  const title = refused ? `Refused: ${refused}` : "Use this part here";
  const act = () => parts.donorRows.ariaBusy || change("take", { clip, from: first, to: last });
  const take = button("Use", title, act, { "aria-label": `Use ${name}` });
  take.disabled = Boolean(refused) || Boolean(lock) || isUsed;
  const see = button("", "Show in place", () => preview(own), { class: "plain" });
  see.append(...breakable(clip), " ", make("span", { text: range(first, last) }));
  const note = refused ? ["why", `not possible: ${refusalOf(refused)}`] : ["tag", "in use now"];
  const row = make(
    "tr",
    { class: refused ? "refused" : isUsed ? "used" : "" },
    make("td", {}, see, refused || isUsed ? make("span", { class: note[0], text: note[1] }) : null),
    cell(own.cost, (value) => value.toFixed(1)),
    cell(own.stretch, (value) => `${value > 0 ? "+" : ""}${(100 * value).toFixed(0)} %`),
    cell(own.seamBefore, (value) => `${value.toFixed(0)}°/${seamAfter.toFixed(0)}°`),
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
