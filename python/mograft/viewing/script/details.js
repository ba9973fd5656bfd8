// The description of a segment, the donors that it could have, and the table of all segments.
import { choicesOf, choose, onChoice } from "./choices.js";
import { redraw, seek } from "./player.js";
import { donorFrames, load } from "./poses.js";
import { clipFrame, create, createButton, find, scene, state, toPageFrame } from "./scene.js";
import { donorName, timeline } from "./timeline.js";

const LABELS = { take: "use here", ban: "never use here", change: "use in the selection" };
const degrees = (value) => `${value.toFixed(1)}°`;
const NOTE =
  "Cost and seams are those between the captured neighbours, as mograft candidates prints them. Point at a part to see it.";
const IDLE =
  "A block is a segment: it names the clip that its frames come from; the angle is the jump of the joints where it begins. " +
  "Click one to see what else could be there; drag over blocks to select frames.";

export function describe({ line, part }) {
  const { row, clip } = line;
  const items = [`${clip.name}, ${row.group}`, `segment ${part}`, `frames ${row.start[part]}–${row.stop[part]}`];
  if (row.cluster[part] >= 0) items.push(`cluster ${row.cluster[part]}`);
  const source = donorName(row, part);
  if (source !== null) {
    const percent = (100 * row.stretch[part]).toFixed(1);
    const duration = Number(percent) ? `duration ${percent > 0 ? "+" : "−"}${Math.abs(percent).toFixed(1)} %` : "same duration";
    items.push(`donor ${source} ${row.first[part]}–${row.last[part]}, ${duration}`);
  } else if (row.grafted) {
    items.push(row.others[part] === 0 ? "captured: no other donor" : "captured");
  }
  for (const own of row.changes) {
    if (own.stop < row.start[part] || own.start > row.stop[part]) continue;
    items.push(`changed in ${own.start}–${own.stop}: ${scene.donors[own.source]} ${own.first}–${own.last}`);
  }
  const sides = ["before", "after"].filter((side) => row[side][part] !== null);
  const seams = sides.map((side) => `${degrees(row[side][part])} ${side}`);
  if (seams.length) items.push(`seam angle ${seams.join(", ")}`);
  const others = row.others[part];
  if (others) items.push(others === 1 ? "1 other donor" : `${others} other donors`);
  return items.join(" · ");
}

let listed = "";

export function writeDetail() {
  const chosen = state.hovered || state.pinned;
  const range = state.range ? `range ${state.range.join("–")}` : "";
  const text = [range, chosen ? describe(chosen) : ""].filter(Boolean).join(" · ") || (timeline.lines.length ? IDLE : "");
  const detail = find("detail");
  if (detail.textContent !== text) detail.textContent = text;
  detail.classList.toggle("idle", !chosen && !range);
  const { pinned } = state;
  const key = pinned ? [timeline.lines.indexOf(pinned.line), pinned.part, state.range].join() : "";
  if (listed === key) return;
  listed = key;
  writeCandidates();
}

// The candidates of a segment, in the order of `mograft candidates`; null if the page has none.
function candidatesOf({ line, part }) {
  const table = scene.candidates[line.clip.candidates]?.[line.row.group];
  if (!table || !(part in table.counts)) return null;
  const offset = table.counts.slice(0, part).reduce((sum, count) => sum + count, 0);
  const list = Array.from({ length: table.counts[part] }, (_, i) => {
    const k = offset + i;
    const [clip, from, to] = [scene.donors[table.source[k]], table.first[k], table.last[k]];
    const isOwn = table.own[k] === 1;
    const { row } = line;
    const isSame = row.source[part] === table.source[k] && row.first[part] === from && row.last[part] === to;
    const isUsed = row.source[part] < 0 ? isOwn : isSame;
    const [cost, stretch, before, after] = ["cost", "stretch", "before", "after"].map((name) => table[name][k]);
    return { clip, from, to, isOwn, isUsed, cost, stretch, before, after };
  });
  return { list, more: table.total[part] - list.length };
}

// Show a donor in place: the group of the selected figure moves as the donor until `null` is given.
export function preview(chosen, own) {
  state.preview = null;
  if (own) {
    const { line, part } = chosen;
    const { clip, row } = line;
    const frames = donorFrames(own.clip, own.from, own.to);
    const index = clip.groups.indexOf(row.group);
    const joints = clip.parents.flatMap((_, joint) => (clip.group[joint] === index ? [joint] : []));
    const [start, stop] = [row.start[part], row.stop[part]];
    if (frames) {
      load(frames.source).then(redraw);
      state.preview = { clip, joints, start, stop, first: own.from, last: own.to, frames };
    }
    const frame = clipFrame(clip, state.frame);
    if (frame < start || frame > stop) seek(toPageFrame(clip, (start + stop) / 2));
  }
  redraw();
}

// The selected range in frames of a figure, or else the segment without the frame that it shares with the next.
function rangeOf({ line: { clip, row }, part }, range = state.range) {
  if (!range) return [row.start[part], Math.max(row.stop[part] - 1, row.start[part])];
  return range.map((frame) => clipFrame(clip, frame));
}

function chooseFor(chosen, kind, own) {
  const { line, part } = chosen;
  const { clip, row } = line;
  const [start, stop] = rangeOf(chosen, kind === "take" || kind === "ban" ? null : state.range);
  const group = clip.rows.length > 1 ? row.group : null;
  choose(clip, { kind, group, row: row.group, part, start, stop, ...(own && { clip: own.clip, from: own.from, to: own.to }) });
}

function writeCandidates() {
  const { pinned } = state;
  preview(null, null);
  const found = pinned && candidatesOf(pinned);
  find("candidates").hidden = !pinned?.line.row.grafted;
  if (find("candidates").hidden) return;
  find("donors").replaceChildren(...(found?.list || []).map((own) => candidateRow(pinned, own)));
  const more = found?.more > 0 ? `${found.more} more: mograft candidates --segment ${pinned.part}. ` : "";
  find("more").textContent = more + (found?.list.some((own) => own.cost !== null) ? NOTE : "");
  const where = state.range ? `${rangeOf(pinned).join("–")}` : "this segment";
  const titles = { keep: "Restore captured motion", change: "Use the next best part" };
  const make = ([kind, text]) => createButton(`${text} in ${where}`, "Add to the command below", () => chooseFor(pinned, kind));
  find("ranges").replaceChildren(...Object.entries(titles).map(make));
  markChoices();
}

function rowOf(cells, kind = "") {
  const record = create("tr", undefined, kind);
  record.append(...cells.map((text) => create("td", text)));
  return record;
}

function candidateRow(chosen, own) {
  const frames = `${own.clip} ${own.from}-${own.to}${own.isOwn ? " (captured)" : ""}`;
  const cells = [own.isUsed ? `${frames}, in use` : frames];
  if (own.cost === null) cells.push("", "", "");
  else cells.push(own.cost.toFixed(2), own.stretch.toFixed(2), `${own.before.toFixed(0)}°/${own.after.toFixed(0)}°`);
  const record = rowOf(cells, own.isUsed ? "used" : "");
  const last = record.appendChild(create("td"));
  for (const kind of ["take", "ban", ...(state.range ? ["change"] : [])]) {
    const button = createButton(LABELS[kind], "Add to the command below", () => chooseFor(chosen, kind, own));
    button.dataset.choice = [kind, own.clip, own.from, own.to].join();
    button.ariaPressed = "false";
    last.append(button, " ");
  }
  for (const kind of ["pointerenter", "focusin"]) record.addEventListener(kind, () => preview(chosen, own));
  for (const kind of ["pointerleave", "focusout"]) record.addEventListener(kind, () => preview(chosen, null));
  return record;
}

// Show which buttons are among the choices.
function markChoices() {
  const { pinned } = state;
  if (!pinned) return;
  const taken = choicesOf(pinned.line.clip).filter(({ row, part }) => row === pinned.line.row.group && part === pinned.part);
  const keys = taken.map(({ kind, clip, from, to }) => [kind, clip, from, to].join());
  for (const button of find("donors").querySelectorAll("button"))
    button.setAttribute("aria-pressed", keys.includes(button.dataset.choice));
}
onChoice(markChoices);

export function writeTable() {
  const records = [];
  for (const line of timeline.lines) {
    const { row, clip } = line;
    for (let part = 0; part < Math.min(row.start.length, 2000); part++) {
      const source = donorName(row, part);
      const record = rowOf([
        clip.name,
        row.group,
        `${row.start[part]}–${row.stop[part]}`,
        row.cluster[part] < 0 ? "" : row.cluster[part],
        source === null ? "" : `${source} ${row.first[part]}–${row.last[part]}`,
        row.before[part] === null ? "" : degrees(row.before[part]),
      ]);
      record.addEventListener("click", () => {
        state.pinned = { line, part };
        seek(toPageFrame(clip, row.start[part]));
        redraw();
      });
      records.push(record);
    }
  }
  find("table").replaceChildren(...records);
}
