// What the reader chose, as commands at the foot of the viewer.
import { clips, create, createButton, find } from "./scene.js";

const choices = new Map(); // For each figure its choices, in the order of the command.
const verdicts = new Map(); // For each figure "star" or "reject".

// Words are quoted as a POSIX shell expects them.
export const quote = (word) => (/^[\w@%+=:,./-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`);
const text = (value) => JSON.stringify(value);

// A donor for a segment, its exclusion, the captured motion in a range, or a donor for a range.
const OPTIONS = {
  take: ({ group, part, clip, from, to }) =>
    `--take ${quote(`${group === null ? "" : `${group}:`}${part}=${clip}:${from}-${to}`)}`,
  ban: (choice) => OPTIONS.take(choice).replace("--take", "--ban"),
  keep: ({ start, stop }) => `--keep ${start}-${stop}`,
  change: ({ row, start, stop, clip, from, to }) =>
    `--change ${quote(`${row}@${start}-${stop}${clip ? `=${clip}:${from}-${to}` : ""}`)}`,
};
const EDITS = {
  take: ({ group, part, clip, from, to }) =>
    `mg.constraints.Use(${part}, (${text(clip)}, ${from}, ${to})${group === null ? "" : `, group=${text(group)}`})`,
  ban: (choice) => EDITS.take(choice).replace("Use", "Ban"),
  keep: ({ start, stop }) => `mg.constraints.KeepOriginal(frames=(${start}, ${stop}))`,
};

// The command line that repeats all choices; for a graft without a file, the call in Python.
export function commandOf(clip) {
  const chosen = choicesOf(clip);
  if (clip.command) return [clip.command, ...chosen.map((choice) => OPTIONS[choice.kind](choice))].join(" ");
  const edits = chosen.filter(({ kind }) => kind !== "change").map((choice) => EDITS[choice.kind](choice));
  const edited = edits.length ? `mg.edit(graft, ${edits.join(", ")})` : "graft";
  const nest = (inner, { row, start, stop, clip: name, from, to }) => {
    const donor = name ? `, (${text(name)}, ${from}, ${to})` : "";
    return `mg.change(${inner}, ${text(row)}, (${start}, ${stop})${donor})`;
  };
  return chosen.filter(({ kind }) => kind === "change").reduce(nest, edited);
}

export const choicesOf = (clip) => choices.get(clip) || [];
export const markOf = (clip) => verdicts.get(clip);

// Two choices exclude each other if both are for the same segment or range, or if one keeps the
// captured motion of the other's segment. Several donors can be banned.
function excludes(a, b) {
  const isTake = [a, b].map(({ kind }) => kind === "take" || kind === "ban");
  const isKeep = a.kind === "keep" || b.kind === "keep";
  if (isTake[0] !== isTake[1]) return isKeep && a.start <= b.stop && b.start <= a.stop;
  if (!isTake[0]) return (isKeep || a.row === b.row) && a.start === b.start && a.stop === b.stop;
  const isSame = a.clip === b.clip && a.from === b.from;
  return a.row === b.row && a.part === b.part && (isSame || a.kind === b.kind) && (isSame || a.kind === "take");
}

// Add a choice in place of those that it excludes, or remove it if it was made before.
export function choose(clip, choice) {
  const isSame = (old) => JSON.stringify(old) === JSON.stringify(choice);
  const rest = choicesOf(clip).filter((old) => !excludes(old, choice));
  const own = choicesOf(clip).some(isSame) ? rest : [...rest, choice];
  if (own.length) choices.set(clip, own);
  else choices.delete(clip);
  writeChoices();
}

export function mark(clip, value) {
  if (verdicts.get(clip) === value) verdicts.delete(clip);
  else verdicts.set(clip, value);
  writeChoices();
}

// Keep the motions with a star; without any star, those that are not rejected.
function keepCommand() {
  if (!verdicts.size) return "";
  const made = clips.filter((clip) => clip.keep !== null);
  const starred = made.filter((clip) => verdicts.get(clip) === "star");
  const kept = starred.length ? starred : made.filter((clip) => verdicts.get(clip) !== "reject");
  if (!kept.length) return "";
  if (!kept.every((clip) => Array.isArray(clip.keep))) return kept.map((clip) => clip.keep).join(" && ");
  const files = kept.flatMap((clip) => clip.keep);
  return `mkdir -p kept && cp ${files.map(quote).join(" ")} kept`;
}

function commandRow(label, command, clear) {
  const field = create("input");
  Object.assign(field, { type: "text", readOnly: true, spellcheck: false, value: command });
  const name = create("label");
  name.append(create("bdi", label), " ", field);
  const copy = createButton("Copy", "Copy the command", () => copyText(field));
  const row = create("p", undefined, "command");
  const forget = createButton("Clear", "Forget these choices", () => {
    clear();
    writeChoices();
  });
  row.append(name, copy, forget);
  return row;
}

function writeChoices() {
  const items = [...choices].map(([clip, own]) => {
    const label = `${clip.name}: ${own.length} ${own.length === 1 ? "choice" : "choices"}`;
    return commandRow(label, commandOf(clip), () => choices.delete(clip));
  });
  const keep = keepCommand();
  if (keep) items.push(commandRow("keep the chosen motions", keep, () => verdicts.clear()));
  find("commands").replaceChildren(...items);
  find("choices").hidden = !items.length;
  find("copied").textContent = "";
  for (const listener of listeners) listener();
}

const listeners = [];
export const onChoice = (listener) => listeners.push(listener);

async function copyText(field) {
  let isCopied = true;
  try {
    await navigator.clipboard.writeText(field.value);
  } catch {
    // In a notebook, the page may not write to the clipboard: the command is then selected.
    field.focus();
    field.select();
    isCopied = document.execCommand("copy");
  }
  find("copied").textContent = isCopied ? "copied" : "selected: press Ctrl+C to copy";
}
