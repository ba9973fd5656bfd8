// Fill the menu of versions from versions.json of the site, which `python -m release.site` writes.
// A build that is in no site, such as one opened from a folder, keeps the menu hidden.
"use strict";

async function fillVersions() {
  const root = new URL(document.documentElement.dataset.content_root, location.href);
  const site = new URL("..", root);
  if (!root.protocol.startsWith("http")) return;
  const response = await fetch(new URL("versions.json", site));
  if (!response.ok) return;
  const current = decodeURIComponent(root.pathname.slice(site.pathname.length, -1));
  const page = location.pathname.slice(root.pathname.length);
  const menu = document.querySelector("#versions select");
  for (const version of await response.json()) {
    const label = version.is_newest_release ? `${version.name} (newest)` : version.name;
    const isCurrent = version.name === current;
    menu.add(new Option(label, version.name, isCurrent, isCurrent));
  }
  menu.addEventListener("change", async () => {
    const other = new URL(`${encodeURIComponent(menu.value)}/`, site);
    const same = new URL(page, other);
    const found = await fetch(same, { method: "HEAD" });
    location.assign(found.ok ? same : other);
  });
  document.querySelector("#versions").hidden = false;
}

fillVersions();
