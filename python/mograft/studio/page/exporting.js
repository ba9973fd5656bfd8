// Export of the kept motions, by default into the character's own file.
import { attempt, send } from "./net.js";
import { motions, on, selected, store } from "./store.js";
import { countViolated } from "./records.js";
import { counted, make, parts } from "./ui.js";

const NONE = "No motion is ticked “Keep for export”: the one on the stage is written.";
const kept = () => motions().filter(({ isKept }) => isKept);
const isGlb = (name) => /\.(glb|gltf)$/i.test(name);

export function startExport() {
  parts.export.addEventListener("click", openExport);
  parts.exportForm.addEventListener("submit", write);
  for (const own of [parts.exportFormat, parts.exportFolder]) own.addEventListener("input", update);
  parts.exportClose.addEventListener("click", () => parts.exportDialog.close());
  on("project selected", () => {
    const count = kept().length;
    parts.export.textContent = count ? `Export ${counted(count, "motion")}…` : "Export this motion…";
    parts.export.disabled = !count && !selected();
  });
}

// One file can hold several motions of these formats.
function update() {
  parts.exportInto.hidden = !["glb", "npz"].includes(parts.exportFormat.value);
  parts.exportPlace.textContent = `Written to ${store.project.folder}/${folderName()}`;
}
const folderName = () => parts.exportFolder.value.trim() || ".";

export function openExport() {
  const own = kept();
  const all = own.length ? own : [selected()];
  const names = all.map(({ name }) => name);
  const violated = all.reduce((sum, each) => sum + countViolated(each), 0);
  const what = own.length ? `${counted(own.length, "motion")} with a tick at “Keep for export”.` : NONE;
  parts.exportWhat.textContent = violated ? `${what} ${counted(violated, "constraint")} violated.` : what;
  const more = names.length > 8 ? [make("li", { text: `and ${names.length - 8} more` })] : [];
  parts.exportNames.replaceChildren(...names.slice(0, 8).map((name) => make("li", {}, make("bdi", { text: name }))), ...more);
  const hasMesh = store.project.sources.some(({ name }) => isGlb(name)) || isGlb(store.project.character || "");
  parts.exportFormat.value = hasMesh ? "glb" : "bvh";
  parts.exportTogether.checked = hasMesh;
  parts.exportClose.textContent = "Cancel";
  parts.exportResult.replaceChildren();
  update();
  parts.exportDialog.showModal();
}

async function write(event) {
  event.preventDefault();
  const into = !parts.exportInto.hidden && parts.exportTogether.checked;
  const ids = kept().length ? null : [selected().id];
  const body = { ids, format: parts.exportFormat.value, folder: folderName(), into, force: parts.exportForce.checked };
  parts.exportResult.replaceChildren(make("p", { text: "Files are written…" }));
  const show = (error) => parts.exportResult.replaceChildren(make("p", { class: "why", text: error.message }));
  const reply = await attempt(() => send("/api/export", body), show);
  if (!reply) return;
  parts.exportClose.textContent = "Close";
  const text = `${counted(reply.files.length, "file")}:`;
  parts.exportResult.replaceChildren(make("p", { text }), make("ul", {}, ...reply.files.map(fileItem)));
}

function fileItem(path) {
  const names = path.split("/");
  const href = `/api/files/${names.map(encodeURIComponent).join("/")}`;
  return make("li", {}, make("bdi", { text: path }), " ", make("a", { href, download: names.at(-1), text: "save a copy" }));
}
