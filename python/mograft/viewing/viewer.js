// The viewer: draws the scene in the page's JSON. It loads no library and uses no network. Names
// come from files and enter the page as text only.
"use strict";
(() => {
  const root = document.getElementById("mograft");
  const scene = JSON.parse(document.getElementById("mograft-data").textContent);
  const find = (name) => root.querySelector(`[data-part="${name}"]`);
  const alone = document.body.classList.contains("alone");
  const clips = scene.clips;
  const first = clips[0];
  const nFrames = Math.max(...clips.map((clip) => Math.round(((clip.frames - 1) * clip.dt) / first.dt) + 1));
  const stage = find("stage");
  const rows = find("rows");
  const overview = find("overview");
  const pen = stage.getContext("2d");

  const state = {
    frame: 0,
    playing: false,
    speed: 1,
    overlay: false,
    follow: true,
    stand: 0,
    trails: false,
    floor: true,
    loop: false,
    yaw: 0.55,
    pitch: 0.22,
    zoom: 1,
    pan: [0, 0],
    window: [0, nFrames - 1],
    pinned: null,
    hovered: null,
  };

  // ---- data ---------------------------------------------------------------------------

  async function inflate(text) {
    const packed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  // Inverse of mograft.viewing.encoding.quantize: second differences in time, mapped to unsigned
  // integers, all low bytes before all high bytes.
  function unpack(bytes, path, clip) {
    const { kept, nodes, unit } = clip;
    const count = kept * nodes * 3;
    const positions = new Float32Array(count);
    for (let track = 0; track < nodes * 3; track++) {
      let value = 0;
      let step = 0;
      for (let k = 0; k < kept; k++) {
        const at = track * kept + k;
        const folded = bytes[at] | (bytes[count + at] << 8);
        step = ((step + ((folded >>> 1) ^ -(folded & 1))) << 16) >> 16;
        value = ((value + step) << 16) >> 16;
        positions[k * nodes * 3 + track] = value * unit + path[k * 3 + (track % 3)];
      }
    }
    return positions;
  }

  // The path of the camera: a moving average of the root, without the sway of single steps.
  function smooth(path, kept, radius) {
    const out = new Float32Array(path.length);
    for (let axis = 0; axis < 3; axis++) {
      const sums = new Float64Array(kept + 1);
      for (let k = 0; k < kept; k++) sums[k + 1] = sums[k] + path[k * 3 + axis];
      for (let k = 0; k < kept; k++) {
        const reach = Math.min(radius, k, kept - 1 - k);
        out[k * 3 + axis] = (sums[k + reach + 1] - sums[k - reach]) / (2 * reach + 1);
      }
    }
    return out;
  }

  async function load(clip) {
    const [pose, root] = await Promise.all([inflate(clip.pose), inflate(clip.path)]);
    const path = new Float32Array(root.buffer, root.byteOffset, clip.kept * 3);
    clip.positions = unpack(pose, path, clip);
    clip.cameraPath = smooth(path, clip.kept, Math.round(0.4 / (clip.dt * clip.step)));
    clip.now = new Float32Array(clip.nodes * 3);
  }

  const clipFrame = (clip, frame) => Math.min(Math.round((frame * first.dt) / clip.dt), clip.frames - 1);

  // Positions of the nodes in a frame, interpolated linearly between the stored frames.
  function pose(clip, frame, out) {
    const at = Math.min(frame / clip.step, clip.kept - 1);
    const low = Math.floor(at);
    const high = Math.min(low + 1, clip.kept - 1);
    const part = at - low;
    const size = clip.nodes * 3;
    for (let i = 0; i < size; i++) {
      const a = clip.positions[low * size + i];
      out[i] = part ? a + part * (clip.positions[high * size + i] - a) : a;
    }
    return out;
  }

  function partAt(row, frame) {
    const { start, stop } = row;
    let low = 0;
    let high = start.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (start[middle] <= frame) low = middle;
      else high = middle - 1;
    }
    return start.length && frame >= start[low] && frame <= stop[low] ? low : -1;
  }

  // ---- colours ------------------------------------------------------------------------

  const ink = {};
  function readTheme() {
    const style = getComputedStyle(root);
    for (const name of ["paper", "text", "faint", "line", "accent", "panel"]) {
      ink[name] = style.getPropertyValue(`--${name}`).trim();
    }
    ink.dark = style.getPropertyValue("--dark").trim() === "1";
    ink.group = Array.from({ length: 8 }, (_, i) => style.getPropertyValue(`--group${i}`).trim());
  }
  function groupColour(name) {
    const index = scene.groups.indexOf(name);
    return index < 0 ? ink.faint : ink.group[index % ink.group.length];
  }
  function clusterColour(cluster) {
    if (cluster < 0) return ink.line;
    const hue = (cluster * 137.508 + 200) % 360;
    return ink.dark ? `hsl(${hue} 45% 42%)` : `hsl(${hue} 62% 76%)`;
  }

  // ---- the stage ----------------------------------------------------------------------

  let size = { width: 1, height: 1, ratio: 1 };

  function tiles() {
    const { width, height } = size;
    if (state.overlay) return [[0, 0, width, height]];
    let best = [1, 0];
    for (let columns = 1; columns <= clips.length; columns++) {
      const lines = Math.ceil(clips.length / columns);
      const room = Math.min(width / columns, (height / lines) * 0.8);
      if (room > best[1] * 1.001) best = [columns, room];
    }
    const columns = best[0];
    const lines = Math.ceil(clips.length / columns);
    return clips.map((_, i) => [
      ((i % columns) * width) / columns,
      (Math.floor(i / columns) * height) / lines,
      width / columns,
      height / lines,
    ]);
  }

  function camera(clip, frame, tile) {
    const [left, top, width, height] = tile;
    const tall = scene.height;
    const sinYaw = Math.sin(state.yaw);
    const cosYaw = Math.cos(state.yaw);
    const sinPitch = Math.sin(state.pitch);
    const cosPitch = Math.cos(state.pitch);
    // A camera that does not follow stays where it was when following was switched off.
    const seen = state.follow ? frame : clipFrame(clip, state.stand);
    const k = Math.min(Math.round(seen / clip.step), clip.kept - 1) * 3;
    const target = [clip.cameraPath[k], scene.floor + 0.5 * tall, clip.cameraPath[k + 2]];
    let distance = (state.follow ? 3.4 : 5) * tall;
    distance /= state.zoom;
    // The figure fills two thirds of the height, and most of the width of a narrow view.
    const focus = 2.25 * Math.min(1.25 * width, height);
    const near = 0.05 * distance;
    const turn = (x, y, z) => {
      x -= target[0];
      y -= target[1];
      z -= target[2];
      const ahead = x * sinYaw + z * cosYaw;
      return [
        x * cosYaw - z * sinYaw + state.pan[0] * tall,
        y * cosPitch - ahead * sinPitch + state.pan[1] * tall,
        distance - (y * sinPitch + ahead * cosPitch),
      ];
    };
    const middle = [left + width / 2, top + height * 0.52];
    const flat = ([x, y, depth]) => {
      const scale = focus / Math.max(depth, near);
      return [middle[0] + x * scale, middle[1] - y * scale, scale];
    };
    // A line that ends behind the camera is clipped at the near plane.
    const line = (a, b) => {
      let p = turn(...a);
      let q = turn(...b);
      if (p[2] < near && q[2] < near) return;
      if (p[2] < near || q[2] < near) {
        const share = (near - p[2]) / (q[2] - p[2]);
        const cut = p.map((value, i) => value + share * (q[i] - value));
        if (p[2] < near) p = cut;
        else q = cut;
      }
      const [from, to] = [flat(p), flat(q)];
      pen.moveTo(from[0], from[1]);
      pen.lineTo(to[0], to[1]);
    };
    return { target, line, point: (x, y, z) => flat(turn(x, y, z)), tall };
  }

  function drawFloor(view) {
    const step = view.tall / 3;
    const [cx, , cz] = view.target.map((value) => Math.round(value / step) * step);
    const reach = 9;
    pen.strokeStyle = ink.line;
    pen.lineWidth = 1;
    for (let i = -reach; i <= reach; i++) {
      // Lines fade with distance, so that the floor has no visible edge.
      for (let k = -reach; k < reach; k++) {
        const away = Math.hypot(i, k + 0.5) / reach;
        if (away >= 1) continue;
        pen.globalAlpha = 1 - away * away;
        pen.beginPath();
        view.line([cx + i * step, scene.floor, cz + k * step], [cx + i * step, scene.floor, cz + (k + 1) * step]);
        view.line([cx + k * step, scene.floor, cz + i * step], [cx + (k + 1) * step, scene.floor, cz + i * step]);
        pen.stroke();
      }
    }
    pen.globalAlpha = 1;
  }

  function drawTrails(clip, frame, view) {
    const back = Math.round(1.5 / clip.dt);
    const step = Math.max(1, clip.step, Math.round(1 / 30 / clip.dt));
    const place = new Float32Array(clip.nodes * 3);
    const trails = clip.tips.map(() => []);
    for (let f = Math.max(0, frame - back); f <= frame; f += step) {
      pose(clip, f, place);
      clip.tips.forEach((tip, i) => trails[i].push(view.point(place[tip * 3], place[tip * 3 + 1], place[tip * 3 + 2])));
    }
    pen.lineWidth = 1.6;
    trails.forEach((trail, i) => {
      pen.strokeStyle = groupColour(clip.groups[clip.group[clip.tips[i]]]);
      for (let k = 1; k < trail.length; k++) {
        pen.globalAlpha = (0.75 * k) / trail.length;
        pen.beginPath();
        pen.moveTo(trail[k - 1][0], trail[k - 1][1]);
        pen.lineTo(trail[k][0], trail[k][1]);
        pen.stroke();
      }
    });
    pen.globalAlpha = 1;
  }

  function drawFigure(clip, view, alpha) {
    const now = clip.now;
    const bones = [];
    const shadow = [];
    pen.lineCap = "round";
    for (let node = 0; node < clip.nodes; node++) {
      const above = clip.parents[node];
      if (above < 0) continue;
      const a = [now[above * 3], now[above * 3 + 1], now[above * 3 + 2]];
      const b = [now[node * 3], now[node * 3 + 1], now[node * 3 + 2]];
      bones.push([view.point(...a), view.point(...b), node]);
      if (state.floor) shadow.push([view.point(a[0], scene.floor, a[2]), view.point(b[0], scene.floor, b[2])]);
    }
    if (shadow.length) {
      // One stroke for all bones: the shadow is not darker where they cross.
      pen.globalAlpha = 0.14 * alpha;
      pen.strokeStyle = ink.text;
      pen.lineWidth = Math.max(1.5, 0.026 * view.tall * shadow[0][0][2]);
      pen.lineJoin = "round";
      pen.beginPath();
      for (const [from, to] of shadow) {
        pen.moveTo(from[0], from[1]);
        pen.lineTo(to[0], to[1]);
      }
      pen.stroke();
    }
    // Farther bones are drawn first.
    bones.sort((p, q) => p[0][2] + p[1][2] - q[0][2] - q[1][2]);
    for (const [from, to, node] of bones) {
      const wide = Math.max(1.5, 0.02 * view.tall * 0.5 * (from[2] + to[2]) * clip.width[node]);
      const colour = groupColour(clip.groups[clip.group[clip.parents[node]]]);
      // A rim along the sides separates crossing limbs; the joints have none.
      for (const [width, style, cap] of [
        [wide + 3, ink.paper, "butt"],
        [wide, colour, "round"],
      ]) {
        pen.globalAlpha = alpha;
        pen.strokeStyle = style;
        pen.lineWidth = width;
        pen.lineCap = cap;
        pen.beginPath();
        pen.moveTo(from[0], from[1]);
        pen.lineTo(to[0], to[1]);
        pen.stroke();
      }
    }
    pen.globalAlpha = 1;
  }

  function drawStage() {
    const { width, height, ratio } = size;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    const places = tiles();
    clips.forEach((clip, i) => {
      const tile = state.overlay ? places[0] : places[i];
      const frame = clipFrame(clip, state.frame);
      pose(clip, frame, clip.now);
      const leader = state.overlay ? first : clip;
      const view = camera(leader, clipFrame(leader, state.frame), tile);
      pen.save();
      pen.beginPath();
      pen.rect(...tile);
      pen.clip();
      if (state.floor && (!state.overlay || i === 0)) drawFloor(view);
      if (state.trails) drawTrails(clip, frame, view);
      drawFigure(clip, view, state.overlay && i ? 0.5 : 1);
      pen.restore();
    });
    if (!state.overlay && clips.length > 1) {
      pen.strokeStyle = ink.line;
      pen.lineWidth = 1;
      for (const [left, top, wide, tall] of places) {
        pen.beginPath();
        if (left > 0) {
          pen.moveTo(left + 0.5, top);
          pen.lineTo(left + 0.5, top + tall);
        }
        if (top > 0) {
          pen.moveTo(left, top + 0.5);
          pen.lineTo(left + wide, top + 0.5);
        }
        pen.stroke();
      }
    }
  }

  // ---- captions: the names of the figures and their donors in this frame ---------------

  const captions = clips.map((clip) => {
    const box = document.createElement("div");
    box.className = "caption";
    const name = document.createElement("bdi");
    name.textContent = clip.name;
    const now = document.createElement("div");
    now.className = "now";
    box.append(name, now);
    find("captions").append(box);
    return { box, now, text: "" };
  });

  function placeCaptions() {
    const places = tiles();
    captions.forEach(({ box }, i) => {
      const tile = state.overlay ? [0, i * 40, size.width, 40] : places[i];
      box.style.left = `${tile[0]}px`;
      box.style.top = `${tile[1]}px`;
      box.style.width = `${tile[2]}px`;
      box.style.opacity = state.overlay && i ? "0.65" : "1";
    });
  }

  function writeCaptions() {
    clips.forEach((clip, i) => {
      const frame = clipFrame(clip, state.frame);
      const text = clip.rows
        .map((row) => [row, partAt(row, frame)])
        .filter(([row, at]) => at >= 0 && row.source[at] >= 0)
        .map(([row, at]) => `${row.group} ← ${scene.donors[row.source[at]]} ${row.first[at]}–${row.last[at]}`)
        .join(" · ");
      if (text !== captions[i].text) captions[i].now.textContent = captions[i].text = text;
    });
  }

  // ---- the timeline -------------------------------------------------------------------

  const lines = [];
  clips.forEach((clip, i) => clip.rows.forEach((row) => lines.push({ clip, row, index: i })));
  const ROW = 18;
  const GAP = 6;
  const offsets = lines.map((line, i) => {
    const breaks = lines.slice(1, i + 1).filter((next, k) => next.clip !== lines[k].clip).length;
    return i * ROW + breaks * GAP;
  });
  const rowsHeight = lines.length ? offsets[lines.length - 1] + ROW : 0;
  let gutter = 110;
  let cachedRows = null; // Picture of the timeline without its cursor.

  const toX = (frame, wide) => gutter + ((frame - state.window[0]) / (state.window[1] - state.window[0] || 1)) * (wide - gutter - 8);
  const toFrame = (x, wide) => state.window[0] + ((x - gutter) / (wide - gutter - 8)) * (state.window[1] - state.window[0]);
  const toPageFrame = (clip, frame) => (frame * clip.dt) / first.dt;

  function fit(context, text, room) {
    if (context.measureText(text).width <= room) return text;
    let low = 0;
    let high = text.length;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (context.measureText(`…${text.slice(-middle)}`).width <= room) low = middle;
      else high = middle - 1;
    }
    return low ? `…${text.slice(-low)}` : "";
  }

  function hatch(context) {
    const tile = document.createElement("canvas");
    tile.width = tile.height = 6 * size.ratio;
    const brush = tile.getContext("2d");
    brush.scale(size.ratio, size.ratio);
    brush.strokeStyle = ink.dark ? "rgba(255,255,255,.42)" : "rgba(0,0,0,.34)";
    brush.lineWidth = 1.2;
    for (const shift of [-6, 0, 6]) {
      brush.moveTo(shift, 6);
      brush.lineTo(shift + 6, 0);
    }
    brush.stroke();
    const pattern = context.createPattern(tile, "repeat");
    pattern.setTransform(new DOMMatrix().scale(1 / size.ratio));
    return pattern;
  }

  function drawRows() {
    const wide = rows.clientWidth;
    const { ratio } = size;
    if (!cachedRows) {
      cachedRows = document.createElement("canvas");
      cachedRows.width = rows.width;
      cachedRows.height = rows.height;
      const brush = cachedRows.getContext("2d");
      brush.scale(ratio, ratio);
      brush.font = "11px system-ui, sans-serif";
      brush.textBaseline = "middle";
      const stripes = hatch(brush);
      lines.forEach((line, i) => {
        const top = offsets[i];
        brush.fillStyle = groupColour(line.row.group);
        brush.fillRect(0, top + 3, 4, ROW - 6);
        brush.fillStyle = ink.text;
        const group = clips.length > 1 ? ` · ${line.row.group}` : "";
        const room = gutter - 16 - brush.measureText(group).width;
        brush.fillText(clips.length > 1 ? fit(brush, line.clip.name, room) + group : fit(brush, line.row.group, room), 9, top + ROW / 2);
        brush.save();
        brush.beginPath();
        brush.rect(gutter, top, wide - gutter - 8, ROW);
        brush.clip();
        const { start, stop, cluster, source } = line.row;
        for (let part = 0; part < start.length; part++) {
          const a = toX(toPageFrame(line.clip, start[part]), wide);
          const b = toX(toPageFrame(line.clip, stop[part]), wide);
          if (b < gutter || a > wide) continue;
          const width = Math.max(b - a - (b - a > 4 ? 1.5 : 0.3), 0.5);
          brush.fillStyle = clusterColour(cluster[part]);
          brush.fillRect(a, top + 1.5, width, ROW - 3);
          if (source[part] >= 0) {
            brush.fillStyle = b - a > 3 ? stripes : "rgba(0,0,0,.2)";
            brush.fillRect(a, top + 1.5, width, ROW - 3);
          }
          const number = `${cluster[part]}`;
          if (cluster[part] >= 0 && b - a > 7 * number.length + 6) {
            const middle = a + width / 2;
            const room = brush.measureText(number).width + 5;
            if (source[part] >= 0) {
              brush.fillStyle = clusterColour(cluster[part]);
              brush.fillRect(middle - room / 2, top + 3, room, ROW - 6);
            }
            brush.fillStyle = ink.dark ? "#fff" : "#111";
            brush.textAlign = "center";
            brush.fillText(number, middle, top + ROW / 2 + 0.5);
            brush.textAlign = "left";
          }
        }
        brush.restore();
      });
    }
    const context = rows.getContext("2d");
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, rows.width, rows.height);
    if (rows.width && rows.height) context.drawImage(cachedRows, 0, 0);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    for (const [part, strong] of [
      [state.hovered, false],
      [state.pinned, true],
    ]) {
      if (part) outline(context, part, wide, strong);
    }
    cursor(context, toX(state.frame, wide), rowsHeight);
  }

  function outline(context, { line, part }, wide, strong) {
    const frame = (target, from, to, dashed) => {
      const top = offsets[lines.indexOf(target)];
      const a = Math.max(toX(toPageFrame(target.clip, from), wide), gutter);
      const b = Math.min(toX(toPageFrame(target.clip, to), wide), wide - 8);
      if (b <= a) return;
      context.strokeStyle = ink.text;
      context.lineWidth = strong ? 2 : 1.2;
      context.setLineDash(dashed ? [3, 2] : []);
      context.strokeRect(a, top + 1.5, b - a - 1, ROW - 3);
      context.setLineDash([]);
    };
    const { row } = line;
    frame(line, row.start[part], row.stop[part], false);
    if (row.source[part] < 0) return;
    const donor = scene.donors[row.source[part]];
    const home = lines.find((other) => other.clip.name === donor && other.row.group === row.group);
    if (home) frame(home, row.first[part], row.last[part], true);
  }

  function cursor(context, x, height) {
    if (x < gutter - 1) return;
    context.fillStyle = ink.accent;
    context.fillRect(x - 1, 0, 2, height);
  }

  function drawOverview() {
    const wide = overview.clientWidth;
    const tall = overview.clientHeight;
    const context = overview.getContext("2d");
    const toPlace = (frame) => gutter + (frame / Math.max(nFrames - 1, 1)) * (wide - gutter - 8);
    context.setTransform(size.ratio, 0, 0, size.ratio, 0, 0);
    context.clearRect(0, 0, wide, tall);
    context.font = "11px system-ui, sans-serif";
    context.textBaseline = "middle";
    context.fillStyle = ink.faint;
    context.fillText(fit(context, first.energy.length ? "energy" : "whole", gutter - 16), 9, tall / 2);
    context.fillStyle = ink.panel;
    context.fillRect(gutter, 2, wide - gutter - 8, tall - 4);
    const [a, b] = state.window.map(toPlace);
    const curve = first.energy;
    const last = toPageFrame(first, first.frames - 1);
    if (curve.length > 1) {
      context.beginPath();
      context.moveTo(toPlace(0), tall - 3);
      curve.forEach((value, i) => context.lineTo(toPlace((i / (curve.length - 1)) * last), tall - 3 - (value / 255) * (tall - 8)));
      context.lineTo(toPlace(last), tall - 3);
      context.fillStyle = ink.faint;
      context.globalAlpha = 0.45;
      context.fill();
      context.globalAlpha = 1;
    }
    if (state.window[0] > 0 || state.window[1] < nFrames - 1) {
      context.strokeStyle = ink.text;
      context.lineWidth = 1.5;
      context.strokeRect(a, 2, Math.max(b - a, 3), tall - 4);
    }
    cursor(context, toPlace(state.frame), tall);
  }

  // ---- description of a segment -------------------------------------------------------

  const degrees = (value) => `${value.toFixed(1)}°`;
  function describe({ line, part }) {
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
    if (row.others[part] !== null && row.others[part] > 0) items.push(`${row.others[part]} other donors`);
    return items.join(" · ");
  }

  function writeDetail() {
    const part = state.hovered || state.pinned;
    const idle = lines.length
      ? "Point at a segment of the timeline to see its donor; click to select it."
      : "";
    const text = part ? describe(part) : idle;
    const detail = find("detail");
    if (detail.textContent !== text) detail.textContent = text;
    detail.classList.toggle("idle", !part);
  }

  function writeTable() {
    const body = find("table");
    body.replaceChildren();
    for (const line of lines) {
      const { row, clip } = line;
      for (let part = 0; part < Math.min(row.start.length, 2000); part++) {
        const cells = [
          clip.name,
          row.group,
          `${row.start[part]}–${row.stop[part]}`,
          row.cluster[part] < 0 ? "" : row.cluster[part],
          row.source[part] < 0 ? "" : `${scene.donors[row.source[part]]} ${row.first[part]}–${row.last[part]}`,
          row.before[part] === null ? "" : degrees(row.before[part]),
        ];
        const record = document.createElement("tr");
        for (const text of cells) {
          const cell = document.createElement("td");
          cell.textContent = text;
          record.append(cell);
        }
        record.addEventListener("click", () => {
          state.pinned = { line, part };
          seek(toPageFrame(clip, row.start[part]));
        });
        body.append(record);
      }
    }
  }

  // ---- drawing after a change ---------------------------------------------------------

  let asked = false;
  function draw() {
    asked = false;
    drawStage();
    writeCaptions();
    if (lines.length) drawRows();
    drawOverview();
    writeDetail();
    const seconds = (state.frame * first.dt).toFixed(2);
    find("time").textContent = `${seconds} s`;
    if (document.activeElement !== find("frame")) find("frame").value = state.frame;
    for (const slider of [rows, overview]) {
      slider.setAttribute("aria-valuenow", state.frame);
      slider.setAttribute("aria-valuetext", `frame ${state.frame} of ${nFrames - 1}, ${seconds} seconds`);
    }
  }
  function redraw() {
    if (!asked) {
      asked = true;
      requestAnimationFrame(draw);
    }
  }

  function seek(frame) {
    state.frame = Math.max(0, Math.min(nFrames - 1, Math.round(frame)));
    const [a, b] = state.window;
    if (state.frame < a || state.frame > b) {
      const span = b - a;
      show(state.frame < a ? state.frame - 0.1 * span : state.frame - 0.1 * span, span);
    }
    redraw();
  }

  function show(start, span) {
    const length = Math.max(Math.min(span, nFrames - 1), Math.min(20, nFrames - 1));
    const from = Math.max(0, Math.min(start, nFrames - 1 - length));
    state.window = [from, from + length];
    cachedRows = null;
    redraw();
  }
  function zoomTime(factor, around) {
    const [a, b] = state.window;
    show(around - (around - a) * factor, (b - a) * factor);
  }

  let clock = 0;
  let carried = 0;
  function tick(time) {
    if (!state.playing) return;
    carried += ((time - clock) / 1000) * (state.speed / first.dt);
    clock = time;
    const whole = Math.floor(carried);
    if (whole > 0) {
      carried -= whole;
      let next = state.frame + whole;
      const { pinned } = state;
      if (state.loop && pinned) {
        const from = Math.round(toPageFrame(pinned.line.clip, pinned.line.row.start[pinned.part]));
        const to = Math.round(toPageFrame(pinned.line.clip, pinned.line.row.stop[pinned.part]));
        if (next > to || next < from) next = from;
      } else if (next > nFrames - 1) next = 0;
      seek(next);
    }
    requestAnimationFrame(tick);
  }
  function play(on) {
    state.playing = on && nFrames > 1;
    const button = find("play");
    button.setAttribute("aria-label", state.playing ? "Pause" : "Play");
    button.dataset.on = state.playing ? "1" : "";
    clock = performance.now();
    carried = 0;
    if (state.playing) requestAnimationFrame(tick);
  }

  function cut(direction) {
    const cuts = new Set([0, nFrames - 1]);
    const line = state.pinned ? state.pinned.line : lines[0];
    if (line) for (const frame of line.row.start) cuts.add(Math.round(toPageFrame(line.clip, frame)));
    const sorted = [...cuts].sort((a, b) => a - b);
    const next = direction > 0 ? sorted.find((f) => f > state.frame) : sorted.findLast((f) => f < state.frame);
    if (next !== undefined) seek(next);
  }

  function toggle(name, value = !state[name]) {
    state[name] = value;
    if (name === "follow") state.stand = state.frame;
    find(name).setAttribute("aria-pressed", value);
    placeCaptions();
    redraw();
  }

  function resize() {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    size = { width: stage.clientWidth, height: stage.clientHeight, ratio };
    gutter = rows.clientWidth < 600 ? 104 : 160;
    rows.style.height = `${rowsHeight}px`;
    for (const canvas of [stage, rows, overview]) {
      canvas.width = Math.round(canvas.clientWidth * ratio);
      canvas.height = Math.round(canvas.clientHeight * ratio);
    }
    cachedRows = null;
    placeCaptions();
    draw();
  }

  // ---- pointer and keyboard -----------------------------------------------------------

  const fingers = new Map();
  let spread = 0;
  stage.addEventListener("contextmenu", (event) => event.preventDefault());
  stage.addEventListener("pointerdown", (event) => {
    stage.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    spread = 0;
  });
  for (const kind of ["pointerup", "pointercancel"]) {
    stage.addEventListener(kind, (event) => fingers.delete(event.pointerId));
  }
  stage.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const [dx, dy] = [event.clientX - before[0], event.clientY - before[1]];
    fingers.set(event.pointerId, [event.clientX, event.clientY]);
    if (fingers.size === 2) {
      const [p, q] = [...fingers.values()];
      const apart = Math.hypot(p[0] - q[0], p[1] - q[1]);
      if (spread) state.zoom = clamp(state.zoom * (apart / spread), 0.1, 20);
      spread = apart;
      pan(dx / 2, dy / 2);
    } else if (event.shiftKey || event.buttons & 6) pan(dx, dy);
    else orbit(-dx * 0.008, dy * 0.008);
  });
  stage.addEventListener(
    "wheel",
    (event) => {
      // In a page that scrolls, the wheel zooms only while the viewer has the focus.
      if (!alone && !root.contains(document.activeElement)) return;
      event.preventDefault();
      zoom(Math.exp(-event.deltaY * 0.0012));
    },
    { passive: false },
  );
  const clamp = (value, low, high) => Math.max(low, Math.min(high, value));
  function orbit(yaw, pitch) {
    state.yaw += yaw;
    state.pitch = clamp(state.pitch + pitch, -0.3, 1.55);
    redraw();
  }
  function pan(dx, dy) {
    const scale = 4 / (Math.min(size.width, size.height) * state.zoom);
    state.pan = [state.pan[0] + dx * scale, state.pan[1] - dy * scale];
    redraw();
  }
  function zoom(factor) {
    state.zoom = clamp(state.zoom * factor, 0.1, 20);
    redraw();
  }
  function reset() {
    Object.assign(state, { yaw: 0.55, pitch: 0.22, zoom: 1, pan: [0, 0], stand: state.frame });
    redraw();
  }

  function under(event) {
    const box = rows.getBoundingClientRect();
    const y = event.clientY - box.top;
    const index = offsets.findIndex((top) => y >= top && y < top + ROW);
    if (index < 0 || event.clientX - box.left < gutter) return null;
    const line = lines[index];
    const frame = toFrame(event.clientX - box.left, rows.clientWidth);
    const part = partAt(line.row, (frame * first.dt) / line.clip.dt);
    return part < 0 ? null : { line, part };
  }
  let scrubbing = null;
  for (const canvas of [rows, overview]) {
    const frameAt = (event) => {
      const x = event.clientX - canvas.getBoundingClientRect().left;
      if (canvas === rows) return toFrame(x, canvas.clientWidth);
      return ((x - gutter) / (canvas.clientWidth - gutter - 8)) * (nFrames - 1);
    };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      scrubbing = canvas;
      if (canvas === rows) state.pinned = under(event);
      seek(frameAt(event));
    });
    canvas.addEventListener("pointermove", (event) => {
      if (canvas === rows) state.hovered = under(event);
      if (scrubbing === canvas) seek(clamp(frameAt(event), ...(canvas === rows ? state.window : [0, nFrames - 1])));
      else redraw();
    });
    for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, () => (scrubbing = null));
    canvas.addEventListener("pointerleave", () => {
      state.hovered = null;
      redraw();
    });
    canvas.addEventListener(
      "wheel",
      (event) => {
        if (!alone && !event.ctrlKey) return;
        event.preventDefault();
        const [a, b] = state.window;
        if (Math.abs(event.deltaX) > Math.abs(event.deltaY)) show(a + (event.deltaX / canvas.clientWidth) * (b - a), b - a);
        else zoomTime(Math.exp(event.deltaY * 0.0015), frameAt(event));
      },
      { passive: false },
    );
  }

  find("play").addEventListener("click", () => play(!state.playing));
  find("back").addEventListener("click", () => cut(-1));
  find("on").addEventListener("click", () => cut(1));
  find("speed").addEventListener("change", (event) => (state.speed = Number(event.target.value)));
  find("frame").addEventListener("change", (event) => {
    seek(Number(event.target.value) || 0);
    event.target.blur(); // The keys control the player again.
  });
  for (const name of ["overlay", "follow", "trails", "floor", "loop"]) {
    find(name).addEventListener("click", () => toggle(name));
  }
  find("wider").addEventListener("click", () => zoomTime(2, state.frame));
  find("nearer").addEventListener("click", () => zoomTime(0.5, state.frame));
  find("reset").addEventListener("click", reset);
  find("theme").addEventListener("click", () => {
    document.documentElement.dataset.theme = ink.dark ? "light" : "dark";
    readTheme();
    legend();
    cachedRows = null;
    redraw();
  });
  find("help").addEventListener("click", () => find("keys").showModal());
  find("close").addEventListener("click", () => find("keys").close());
  find("parts").addEventListener("toggle", (event) => event.target.open && writeTable());

  const keys = {
    " ": () => play(!state.playing),
    ArrowRight: (event) => seek(state.frame + (event.shiftKey ? 10 : 1)),
    ArrowLeft: (event) => seek(state.frame - (event.shiftKey ? 10 : 1)),
    Home: () => seek(0),
    End: () => seek(nFrames - 1),
    "[": () => cut(-1),
    "]": () => cut(1),
    o: () => toggle("overlay"),
    f: () => toggle("follow"),
    t: () => toggle("trails"),
    g: () => toggle("floor"),
    l: () => toggle("loop"),
    a: () => orbit(-0.15, 0),
    d: () => orbit(0.15, 0),
    w: () => orbit(0, 0.1),
    s: () => orbit(0, -0.1),
    "+": () => zoom(1.2),
    "-": () => zoom(1 / 1.2),
    0: reset,
    "?": () => find("keys").showModal(),
  };
  (alone ? document : root).addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || find("keys").open) return;
    const isTyping = event.target.closest("input, select, summary");
    const isButton = event.key === " " && event.target.closest("button");
    const act = keys[event.key];
    if (!act || isTyping || isButton) return;
    event.preventDefault();
    act(event);
  });

  function legend() {
    const box = find("legend");
    box.replaceChildren();
    for (const group of scene.groups) {
      const item = document.createElement("li");
      const dot = document.createElement("i");
      dot.style.background = groupColour(group);
      const name = document.createElement("bdi");
      name.textContent = group;
      item.append(dot, name);
      box.append(item);
    }
  }

  // ---- start --------------------------------------------------------------------------

  async function begin() {
    if (typeof DecompressionStream === "undefined") {
      throw new Error("the browser must support DecompressionStream (2023)");
    }
    await Promise.all(clips.map(load));
    readTheme();
    legend();
    for (const slider of [rows, overview]) {
      slider.setAttribute("aria-valuemin", 0);
      slider.setAttribute("aria-valuemax", nFrames - 1);
    }
    find("frame").max = nFrames - 1;
    find("total").textContent = `/ ${nFrames - 1}`;
    find("overlay").hidden = clips.length < 2;
    find("loop").hidden = find("parts").hidden = !lines.length;
    rows.hidden = !lines.length;
    const names = clips.map((clip) => clip.name).join(" and ");
    stage.setAttribute("aria-label", `Moving figures: ${names}. Space plays, arrow keys step.`);
    find("note").textContent = scene.note;
    // If segments are too narrow to point at, only a part of the timeline is visible at first.
    const most = Math.max(0, ...lines.map((line) => line.row.start.length));
    state.follow = scene.follow;
    find("follow").setAttribute("aria-pressed", state.follow);
    resize();
    const fit = Math.max(rows.clientWidth / 28, 8);
    if (most > 1.5 * fit) show(0, ((nFrames - 1) * fit) / most);
    new ResizeObserver(resize).observe(root);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      readTheme();
      legend();
      cachedRows = null;
      redraw();
    });
    draw();
    root.dataset.ready = "1";
    // Interface for scripts: tests, and other scripts in the page.
    window.mograft = {
      frames: nFrames,
      seek: (frame) => {
        seek(frame);
        draw();
      },
      frame: () => state.frame,
      pose: (clip, frame) => Array.from(pose(clips[clip], frame, new Float32Array(clips[clip].nodes * 3))),
      describe: (row, part) => describe({ line: lines[row], part }),
      state,
    };
  }

  begin().catch((error) => {
    find("detail").textContent = `The motion cannot be shown: ${error.message}`;
    root.dataset.ready = "failed";
  });
})();
