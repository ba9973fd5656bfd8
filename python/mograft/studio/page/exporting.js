// Export of the kept motions, by default into the character's own file.
import { find } from "/viewer/scene.js";
import { attempt, send } from "./net.js";
import { motions, on, selected, store } from "./store.js";
import { button, field, make, openDialog, selectInput } from "./ui.js";

const FORMATS = [
  ["glb", "GLB (glTF 2.0)"],
  ["bvh", "BVH"],
  ["npz", "NPZ (NumPy, AMASS)"],
  ["usda", "USD"],
  ["csv", "CSV"],
];

export function startExport() {
  find("export").addEventListener("click", openExport);
  on("project", () => {
    const count = motions().filter(({ isKept }) => isKept).length;
    find("export").textContent = count ? `Export ${count}…` : "Export…";
    find("export").disabled = !motions().length;
  });
}

export function openExport() {
  const kept = motions().filter(({ isKept }) => isKept);
  const ids = kept.length ? null : [selected().id];
  const written = kept.length ? kept : [selected()];
  const isGlb = store.project.sources.some(({ name }) => /\.(glb|gltf)$/i.test(name)) || /\.(glb|gltf)$/i.test(store.project.character || "");
  const format = selectInput(store.project.formats || FORMATS, isGlb ? "glb" : "bvh");
  const into = make("input", { type: "checkbox", checked: isGlb });
  const folder = make("input", { type: "text", value: "export" });
  const force = make("input", { type: "checkbox" });
  const result = make("div", { class: "result", role: "status" });
  const intoRow = field("into the character's own file", into);
  const isInto = () => format.value === "glb" && isGlb;
  const update = () => (intoRow.hidden = !isInto());
  format.addEventListener("change", update);
  const write = async (event) => {
    event.preventDefault();
    result.replaceChildren(make("span", { text: "Files are written…" }));
    const body = { ids, format: format.value, folder: folder.value.trim() || ".", into: isInto() && into.checked, force: force.checked };
    const reply = await attempt(async () => {
      try {
        return await send("/api/export", body);
      } catch (error) {
        result.replaceChildren(make("p", { class: "why", text: error.message }));
        throw error;
      }
    });
    if (reply) result.replaceChildren(make("p", { text: reply.files.length === 1 ? "1 file:" : `${reply.files.length} files:` }), make("ul", {}, ...reply.files.map(fileItem)));
  };
  const what = kept.length ? `${kept.length === 1 ? "1 kept motion" : `${kept.length} kept motions`}` : `No motion is kept: the shown one, ${written[0].name}`;
  const dialog = openDialog(
    "Export",
    make("p", { text: what }),
    make("ul", { class: "names-list" }, ...written.slice(0, 8).map(({ name }) => make("li", {}, make("bdi", { text: name }))), ...(written.length > 8 ? [make("li", { text: `and ${written.length - 8} more` })] : [])),
    make(
      "form",
      { class: "form", onsubmit: write },
      field("format", format),
      intoRow,
      field("folder", folder),
      make("p", { class: "faint", text: `below ${store.project.folder}` }),
      field("overwrite files", force),
      make("div", { class: "row" }, make("button", { type: "submit", class: "main", text: "Write" }), button("Close", "Escape", () => dialog.close())),
    ),
    result,
  );
  update();
}

function fileItem(path) {
  const relative = path.startsWith(store.project.folder) ? path.slice(store.project.folder.length).replace(/^[\\/]+/, "") : path;
  const address = `/api/files/${relative.split(/[\\/]/).map(encodeURIComponent).join("/")}`;
  return make("li", {}, make("bdi", { text: relative }), " ", make("a", { href: address, download: relative.split(/[\\/]/).at(-1), text: "save a copy" }));
}
