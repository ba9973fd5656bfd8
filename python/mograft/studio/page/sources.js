// What is open: files, clips with their faults, the library, the character; and how to open more.
import { attempt, say, send, upload } from "./net.js";
import { act, on, store } from "./store.js";
import { button, counted, details, fill, make, named, parts, range, showTab } from "./ui.js";

const SUFFIXES = ".bvh,.glb,.gltf,.fbx,.npz,.npy,.usd,.usda,.usdc,.usdz,.csv,.json,.bin,.png,.jpg,.toml";

export function startSources() {
  parts.character.addEventListener("change", () => act({ action: "set_character", path: parts.character.value || null }));
  parts.preset.addEventListener("change", () => parts.preset.value && act({ action: "set_groups", preset: parts.preset.value }));
  for (const own of [parts.open, parts.openHere, parts.openFirst]) own.addEventListener("click", openFiles);
  parts.chooseFiles.addEventListener("click", () => parts.fileInput.click());
  parts.chooseFolder.addEventListener("click", () => parts.folderInput.click());
  parts.fileInput.accept = SUFFIXES;
  for (const input of [parts.fileInput, parts.folderInput]) input.addEventListener("change", () => sendChosen(input));
  parts.pathForm.addEventListener("submit", openPath);
  listenToDrops();
  on("project", write);
  on("progress", writeProgress);
}

let listed = "";
function write() {
  const { sources, clips, groups, character, library, motions } = store.project;
  const project = named("span", {}, store.project.name || "", store.project.file ? " saved with every change" : "");
  parts.project.replaceChildren(...project.children);
  parts.project.title = store.project.file || "";
  document.title = `${store.project.name || "new project"} · mograft studio`;
  const next = JSON.stringify([sources, clips]);
  if (next !== listed) parts.sources.replaceChildren(...sources.map(sourceItem));
  if (next !== listed) parts.clips.replaceChildren(...clips.map(clipItem));
  listed = next;
  parts.settings.hidden = !groups?.names?.length;
  const presets = (groups?.presets || []).map((name) => [name, name.replaceAll("_", ", ")]);
  fill(parts.preset, groups?.preset ? presets : [["", "own groups"], ...presets], groups?.preset || "");
  const meshes = sources.filter(({ name }) => /\.(glb|gltf)$/i.test(name)).map(({ path, name }) => [path, name]);
  const isOther = character && !meshes.some(([path]) => path === character);
  if (isOther) meshes.push([character, character.split(/[\\/]/).at(-1)]);
  fill(parts.character, [["", "the character of each file"], ...meshes], character || "");
  writeLibrary(library);
  writeProgress();
  parts.welcome.hidden = sources.length > 0 || motions.length > 0;
}

function sourceItem({ name, clips, status, message, path }) {
  const text = status === "ok" ? counted(clips, "clip") : status;
  const item = named("li", { class: `source ${status}`, title: path }, name, text, "tag");
  if (message) item.append(make("p", { class: "why", text: message }));
  return item;
}

function clipItem({ name, frames, rate, faults }) {
  const choose = () => {
    parts.makeBase.value = name;
    parts.makeBase.dispatchEvent(new Event("change"));
  };
  const show = button("", "Choose as base, and show on the stage", choose, { class: "plain" });
  show.append(...named("span", {}, name, ` ${(frames / rate).toFixed(1)} s, ${Math.round(rate)} fps`).childNodes);
  const item = make("li", {}, show);
  const list = faults.map(({ kind, first, last, text }) => make("li", { text: `frames ${range(first, last)}: ${text || kind}` }));
  if (list.length) item.append(details(counted(list.length, "fault"), make("ul", {}, ...list)));
  return item;
}

function writeLibrary({ status, done, total, segments, message }) {
  const building = `Library: ${done} of ${total} clips…`;
  const texts = { building, ready: `Library: ${segments} segments ready.`, failed: `Library: ${message}` };
  parts.library.replaceChildren(make("span", { class: status === "failed" ? "why" : "", text: texts[status] ?? "" }));
  if (status === "building")
    parts.library.append(make("progress", { max: Math.max(total, 1), value: done, "aria-label": "Library" }));
  const notes = status === "ready" && message ? message.split("\n") : [];
  if (notes.length) parts.library.append(details(counted(notes.length, "note"), ...notes.map((text) => make("p", { text }))));
}

// What the server does at present: all jobs, or that of an event.
function writeProgress(event) {
  const { library, jobs } = store.project || {};
  const building = library?.status === "building" ? [{ text: "Library", ...library }] : [];
  const running = event?.total ? [event] : [...building, ...(jobs || [])];
  parts.jobs.textContent = running.map(({ text, done, total }) => (total ? `${text} ${done}/${total}` : text)).join(" · ");
}

export const openFiles = () => parts.openDialog.showModal();

function sendChosen(input) {
  const files = [...input.files].map((file) => ({ file, name: file.webkitRelativePath || file.name }));
  input.value = "";
  parts.openDialog.close();
  sendFiles(files);
}

async function openPath(event) {
  event.preventDefault();
  const path = parts.pathInput.value.trim();
  if (path && (await attempt(() => send("/api/open", { paths: [path] })))) parts.openDialog.close();
}

// Send files to the folder of the project, and open them.
export async function sendFiles(given) {
  const paths = [];
  for (const [index, { file, name }] of given.entries()) {
    parts.jobs.textContent = `Sending ${index + 1} of ${given.length}: ${name}`;
    const found = await attempt(() => upload(name, file));
    if (found?.path) paths.push(found.path);
  }
  parts.jobs.textContent = "";
  if (!paths.length) return;
  const tops = [...new Set(paths)];
  if (await attempt(() => send("/api/open", { paths: tops }))) say(`${counted(tops.length, "file")} opened.`);
  showTab(document.getElementById("tab-clips"));
}

// The files of dropped files and folders.
async function filesOf(entry, folder = "") {
  if (entry.isFile)
    return [{ file: await new Promise((resolve, reject) => entry.file(resolve, reject)), name: folder + entry.name }];
  const reader = entry.createReader();
  const found = [];
  for (;;) {
    const part = await new Promise((resolve, reject) => reader.readEntries(resolve, reject));
    if (!part.length) break;
    for (const own of part) found.push(...(await filesOf(own, `${folder}${entry.name}/`)));
  }
  return found;
}

function listenToDrops() {
  const isFiles = (event) => event.dataTransfer?.types.includes("Files");
  let depth = 0;
  window.addEventListener("dragenter", (event) => {
    if (!isFiles(event)) return;
    depth++;
    parts.drop.hidden = false;
  });
  window.addEventListener("dragleave", () => {
    depth = Math.max(0, depth - 1);
    parts.drop.hidden = depth === 0;
  });
  window.addEventListener("dragover", (event) => isFiles(event) && event.preventDefault());
  window.addEventListener("drop", async (event) => {
    if (!isFiles(event)) return;
    event.preventDefault();
    depth = 0;
    parts.drop.hidden = true;
    const items = [...event.dataTransfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
    const plain = [...event.dataTransfer.files].map((file) => ({ file, name: file.name }));
    const found = items.length ? (await Promise.all(items.map((own) => filesOf(own)))).flat() : plain;
    await sendFiles(found.filter(({ name }) => !name.split("/").some((part) => part.startsWith("."))));
  });
}
