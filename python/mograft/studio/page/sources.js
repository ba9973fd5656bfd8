// What is open: files, clips with their faults, the library, the character; and how to open more.
import { find } from "/viewer/scene.js";
import { attempt, say, send, upload } from "./net.js";
import { act, on, store } from "./store.js";
import { button, field, make, openDialog, range, selectInput, showTab } from "./ui.js";

const SUFFIXES = ".bvh,.glb,.gltf,.fbx,.npz,.npy,.usd,.usda,.usdc,.usdz,.csv,.json,.bin,.png,.jpg,.toml";

const parts = {};

export function startSources() {
  const pane = document.getElementById("pane-clips");
  parts.open = button("Open files…", "Ctrl+O", openFiles);
  parts.files = make("ul", { class: "sources", "aria-label": "Files" });
  parts.library = make("div", { class: "library", role: "status" });
  parts.clips = make("ul", { class: "clips", "aria-label": "Clips" });
  parts.character = selectInput([], "", { onchange: (event) => act({ action: "set_character", path: event.target.value || null }) });
  parts.preset = selectInput([], "", { onchange: (event) => event.target.value && act({ action: "set_groups", preset: event.target.value }) });
  parts.edit = button("Edit groups…", "Click joints on the figure", () => find("leftTabs").dispatchEvent(new CustomEvent("edit-groups")));
  parts.settings = make("div", { class: "form" }, make("h3", { text: "Groups and character" }), make("div", { class: "set" }, field("groups", parts.preset), parts.edit), field("character", parts.character));
  pane.append(parts.open, parts.files, parts.library, parts.settings, make("h3", { text: "Clips" }), parts.clips);
  find("open").addEventListener("click", openFiles);
  listenToDrops();
  on("project", write);
  on("progress", writeProgress);
}

function write() {
  const { sources, clips, groups, character, library, motions } = store.project;
  find("project").replaceChildren(make("bdi", { text: store.project.name || "" }), make("span", { class: "faint", text: store.project.file ? "saved with every change" : "" }));
  find("project").title = store.project.file || "";
  document.title = `${store.project.name || "new project"} · mograft studio`;
  parts.files.replaceChildren(...sources.map(sourceItem));
  parts.clips.replaceChildren(...clips.map(clipItem));
  parts.settings.hidden = !groups?.names?.length;
  const presets = groups?.presets || [];
  const key = JSON.stringify([presets, groups?.preset]);
  if (parts.preset.dataset.key !== key) {
    parts.preset.dataset.key = key;
    parts.preset.replaceChildren(...(groups?.preset ? [] : [make("option", { value: "", text: "own groups" })]), ...presets.map((name) => make("option", { value: name, text: name.replaceAll("_", ", ") })));
    parts.preset.value = groups?.preset || "";
  }
  const meshes = sources.filter(({ name }) => /\.(glb|gltf|fbx)$/i.test(name));
  parts.character.replaceChildren(make("option", { value: "", text: "that of each file" }), ...meshes.map(({ path, name }) => make("option", { value: path, text: name })));
  if (character && !meshes.some(({ path }) => path === character)) parts.character.append(make("option", { value: character, text: character.split(/[\\/]/).at(-1) }));
  parts.character.value = character || "";
  writeProgress({ library });
  writeWelcome(!sources.length && !motions.length);
}

function sourceItem({ name, clips, status, message, path }) {
  const text = status === "ok" ? (clips === 1 ? "1 clip" : `${clips} clips`) : status;
  const item = make("li", { class: `source ${status}`, title: path }, make("bdi", { text: name }), make("span", { class: "tag", text }));
  if (message) item.append(make("p", { class: "why", text: message }));
  return item;
}

function clipItem({ name, frames, rate, faults }) {
  const item = make("li", {}, make("bdi", { text: name }), make("span", { class: "faint", text: ` ${(frames / rate).toFixed(1)} s, ${Math.round(rate)} fps` }));
  if (!faults.length) return item;
  const list = faults.map(({ kind, first, last, text }) => make("li", { text: `frames ${range(first, last)}: ${text || kind}` }));
  item.append(make("details", {}, make("summary", { text: faults.length === 1 ? "1 fault" : `${faults.length} faults` }), make("ul", {}, ...list)));
  return item;
}

function writeProgress({ library, ...event }) {
  const jobs = event.total ? [event] : store.project?.jobs || [];
  const running = jobs.map(({ text, done, total }) => (total ? `${text} ${done}/${total}` : text));
  if (library) {
    const { status, done, total, segments, message } = library;
    const texts = { none: "", building: `Library: ${done} of ${total} clips…`, ready: `Library: ${segments} segments ready.`, failed: `Library: ${message}` };
    const bar = status === "building" ? make("progress", { max: Math.max(total, 1), value: done, "aria-label": "Library" }) : null;
    parts.library.replaceChildren(make("span", { class: status === "failed" ? "why" : "", text: texts[status] ?? message ?? "" }), ...(bar ? [bar] : []));
    if (status === "building") running.unshift(texts.building);
    if (status === "ready" && message) parts.library.append(make("p", { class: "faint", text: message }));
  }
  find("jobs").textContent = running.join(" · ");
}

function writeWelcome(isEmpty) {
  const box = find("welcome");
  box.hidden = !isEmpty;
  if (!isEmpty || box.childElementCount) return;
  box.append(
    make("h2", { text: "Open motions to begin" }),
    make("p", { text: "Drop files or folders here: GLB, FBX, BVH, NPZ or USD. They stay on this computer." }),
    button("Open files…", "Ctrl+O", openFiles, { class: "main" }),
  );
}

export function openFiles() {
  const [files, folder] = [false, true].map((isFolder) => {
    const input = make("input", { type: "file", multiple: true, class: "hidden", tabindex: "-1", "aria-hidden": "true", ...(isFolder ? { webkitdirectory: "" } : { accept: SUFFIXES }) });
    input.addEventListener("change", () => {
      dialog.close();
      sendFiles([...input.files].map((file) => ({ file, name: file.webkitRelativePath || file.name })));
    });
    return input;
  });
  const path = make("input", { type: "text", "aria-label": "Path on this computer", placeholder: "path below the folders of the studio" });
  const openPath = async (event) => {
    event.preventDefault();
    if (!path.value.trim()) return;
    const done = await attempt(() => send("/api/open", { paths: [path.value.trim()] }));
    if (done) dialog.close();
  };
  const dialog = openDialog(
    "Open",
    make("p", { class: "faint", text: "Motions in GLB, FBX, BVH, NPZ or USD; a library, a project, or a graft with its .json file." }),
    make("div", { class: "row" }, button("Files…", "Choose files", () => files.click(), { class: "main" }), button("Folder…", "Choose a folder", () => folder.click()), files, folder),
    make("form", { class: "row", onsubmit: openPath }, path, make("button", { type: "submit", text: "Open path" })),
    make("div", { class: "row end" }, button("Close", "Escape", () => dialog.close())),
  );
}

// Send files to the folder of the project, and open them.
export async function sendFiles(given) {
  const paths = [];
  for (const [index, { file, name }] of given.entries()) {
    find("jobs").textContent = `Sending ${index + 1} of ${given.length}: ${name}`;
    const found = await attempt(() => upload(name, file));
    if (found?.path) paths.push(found.path);
  }
  find("jobs").textContent = "";
  if (!paths.length) return;
  const tops = [...new Set(paths)];
  if (await attempt(() => send("/api/open", { paths: tops }))) say(tops.length === 1 ? "1 file is opened." : `${tops.length} files are opened.`);
  showTab(document.getElementById("tab-clips"));
}

// The files of dropped files and folders.
async function filesOf(entry, folder = "") {
  if (entry.isFile) return [{ file: await new Promise((resolve, reject) => entry.file(resolve, reject)), name: folder + entry.name }];
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
    find("drop").hidden = false;
  });
  window.addEventListener("dragleave", () => {
    depth = Math.max(0, depth - 1);
    find("drop").hidden = depth === 0;
  });
  window.addEventListener("dragover", (event) => isFiles(event) && event.preventDefault());
  window.addEventListener("drop", async (event) => {
    if (!isFiles(event)) return;
    event.preventDefault();
    depth = 0;
    find("drop").hidden = true;
    const items = [...event.dataTransfer.items].map((item) => item.webkitGetAsEntry?.()).filter(Boolean);
    const plain = [...event.dataTransfer.files].map((file) => ({ file, name: file.name }));
    const found = items.length ? (await Promise.all(items.map((own) => filesOf(own)))).flat() : plain;
    await sendFiles(found.filter(({ name }) => !name.split("/").some((part) => part.startsWith("."))));
  });
}
