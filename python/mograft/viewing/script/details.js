// The description of a segment, the donors that it could have, and the table of all segments.
import { redraw, seek } from "./player.js";
import { create, find, scene, state, toPageFrame } from "./scene.js";
import { timeline } from "./timeline.js";

const degrees = (value) => `${value.toFixed(1)}°`;

export function describe({ line, part }) {
  const { row, clip } = line;
  const items = [`${clip.name}, ${row.group}`, `segment ${part}`, `frames ${row.start[part]}–${row.stop[part]}`];
  if (row.cluster[part] >= 0) items.push(`cluster ${row.cluster[part]}`);
  if (row.source[part] >= 0) {
    const stretch = row.stretch[part];
    const percent = `${stretch > 0 ? "+" : "−"}${(100 * Math.abs(stretch)).toFixed(1)} %`;
    const duration = Math.abs(stretch) < 0.0005 ? "same duration" : `duration ${percent}`;
    items.push(`donor ${scene.donors[row.source[part]]} ${row.first[part]}–${row.last[part]}, ${duration}`);
  } else if (row.grafted) {
    items.push(row.others[part] === 0 ? "captured: no other donor" : "captured");
  }
  const seams = [];
  if (row.before[part] !== null) seams.push(`${degrees(row.before[part])} before`);
  if (row.after[part] !== null) seams.push(`${degrees(row.after[part])} after`);
  if (seams.length) items.push(`seam angle ${seams.join(", ")}`);
  const others = row.others[part];
  if (others) items.push(others === 1 ? "1 other donor" : `${others} other donors`);
  return items.join(" · ");
}

const NOTE = "Cost and seams are those between the captured neighbours, as mograft candidates prints them.";

let listed = null;

export function writeDetail() {
  const chosen = state.hovered || state.pinned;
  const idle = timeline.lines.length
    ? "Point at a segment of the timeline to see its donor; click to list the donors that it could have."
    : "";
  const text = chosen ? describe(chosen) : idle;
  const detail = find("detail");
  if (detail.textContent !== text) detail.textContent = text;
  detail.classList.toggle("idle", !chosen);
  if (listed?.row === state.pinned?.line.row && listed?.part === state.pinned?.part) return;
  listed = state.pinned && { row: state.pinned.line.row, part: state.pinned.part };
  writeCandidates();
}

// Words are quoted as a POSIX shell expects them.
const quote = (word) => (/^[\w@%+=:,./-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`);

// The candidates of a segment, in the order of `mograft candidates`; null if the page has none.
export function candidatesOf({ line, part }) {
  const table = scene.candidates[line.clip.candidates]?.[line.row.group];
  if (!table || !(part in table.counts)) return null;
  const offset = table.counts.slice(0, part).reduce((sum, count) => sum + count, 0);
  const list = Array.from({ length: table.counts[part] }, (_, i) => {
    const k = offset + i;
    const [clip, from, to] = [scene.donors[table.source[k]], table.first[k], table.last[k]];
    return {
      clip,
      frames: `${from}-${to}`,
      cost: table.cost[k],
      stretch: table.stretch[k],
      before: table.before[k],
      after: table.after[k],
      isOwn: table.own[k] === 1,
      isUsed: isUsed(line, part, table.own[k] === 1, table.source[k], from, to),
      ...commands(line, part, clip, from, to),
    };
  });
  return { list, more: table.total[part] - list.length };
}

// How to use a donor and how to exclude it: on the command line, or for a graft without a file as a
// constraint in Python. The group is named if several groups are exchanged.
function commands({ clip: figure, row }, part, clip, from, to) {
  const isGroup = figure.rows.length > 1;
  if (figure.command === null) {
    const group = isGroup ? `, group=${JSON.stringify(row.group)}` : "";
    const edit = `(${part}, (${JSON.stringify(clip)}, ${from}, ${to})${group})`;
    return { take: `mg.constraints.Use${edit}`, ban: `mg.constraints.Ban${edit}` };
  }
  const edit = quote(`${isGroup ? `${row.group}:` : ""}${part}=${clip}:${from}-${to}`);
  return { take: `${figure.command} --take ${edit}`, ban: `${figure.command} --ban ${edit}` };
}

function isUsed({ row }, part, isOwn, source, from, to) {
  if (row.source[part] < 0) return isOwn;
  return row.source[part] === source && row.first[part] === from && row.last[part] === to;
}

function writeCandidates() {
  const found = state.pinned && candidatesOf(state.pinned);
  find("candidates").hidden = !found;
  if (!found) return;
  find("donors").replaceChildren(...found.list.map(candidateRow));
  const more = found.more > 0 ? `${found.more} more: mograft candidates --segment ${state.pinned.part}. ` : "";
  const isPriced = found.list.some((own) => own.cost !== null);
  find("more").textContent = more + (isPriced ? NOTE : "");
  find("command").value = "";
  find("copied").textContent = "take or ban copies the command that does it";
}

function candidateRow(own) {
  const record = create("tr", undefined, own.isUsed ? "used" : "");
  const name = own.isOwn ? `${own.clip} ${own.frames} (captured)` : `${own.clip} ${own.frames}`;
  const cells = [own.isUsed ? `${name}, in use` : name];
  if (own.cost === null) cells.push("", "", "");
  else cells.push(own.cost.toFixed(2), own.stretch.toFixed(2), `${own.before.toFixed(0)}°/${own.after.toFixed(0)}°`);
  record.append(...cells.map((text) => create("td", text)));
  const last = create("td");
  for (const word of ["take", "ban"]) {
    const button = create("button", word);
    button.type = "button";
    button.title = `Copy ${own[word]}`;
    button.addEventListener("click", () => copy(own[word]));
    last.append(button, " ");
  }
  record.append(last);
  return record;
}

async function copy(text) {
  const field = find("command");
  field.value = text;
  let isCopied = false;
  try {
    await navigator.clipboard.writeText(text);
    isCopied = true;
  } catch {
    // In a notebook, the page may not write to the clipboard: the command is then selected.
    field.focus();
    field.select();
    isCopied = document.execCommand("copy");
  }
  find("copied").textContent = isCopied ? "copied" : "selected: press Ctrl+C to copy";
}

export function writeTable() {
  const records = [];
  for (const line of timeline.lines) {
    const { row, clip } = line;
    for (let part = 0; part < Math.min(row.start.length, 2000); part++) {
      const record = create("tr");
      const cells = [
        clip.name,
        row.group,
        `${row.start[part]}–${row.stop[part]}`,
        row.cluster[part] < 0 ? "" : row.cluster[part],
        row.source[part] < 0 ? "" : `${scene.donors[row.source[part]]} ${row.first[part]}–${row.last[part]}`,
        row.before[part] === null ? "" : degrees(row.before[part]),
      ];
      record.append(...cells.map((text) => create("td", text)));
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
