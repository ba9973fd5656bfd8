// Obstacles and targets of constraints.
import { ink } from "./colours.js";
import { pose } from "./poses.js";
import { clamp, first, scene, state } from "./scene.js";

const BOX_FACES = [
  [0, 1, 3, 2],
  [4, 5, 7, 6],
  [0, 1, 5, 4],
  [2, 3, 7, 6],
  [0, 2, 6, 4],
  [1, 3, 7, 5],
];

const MIN_TARGET = 5; // Radius of the mark of a target in pixels, at least.

const isActive = ({ frames }) => !frames || (state.frame >= frames[0] && state.frame <= frames[1]);

// Draw the objects behind the figure, or those in front of it and all labels.
export function drawObjects(pen, { clip, view }, isBehind) {
  const bodyScale = view.point(...view.target)[2];
  for (const object of scene.objects) {
    const { kind, center } = object;
    if ((!center || view.point(...center)[2] <= bodyScale) !== isBehind) continue;
    pen.save();
    setInk(pen, object);
    DRAW[kind](pen, object, view, clip);
    pen.restore();
  }
  if (isBehind) return;
  for (const object of scene.objects.filter(isActive)) {
    pen.save();
    setInk(pen, object);
    drawLabel(pen, object, view);
    pen.restore();
  }
}

function setInk(pen, object) {
  const colour = { target: ink.accent, figure: ink.character }[object.kind] || ink.obstacle;
  pen.globalAlpha = isActive(object) ? 1 : 0.35;
  pen.strokeStyle = pen.fillStyle = colour;
}

function fillAndStroke(pen) {
  const alpha = pen.globalAlpha;
  pen.globalAlpha = 0.2 * alpha;
  pen.fill();
  pen.globalAlpha = 0.8 * alpha;
  pen.lineWidth = 1.2;
  pen.stroke();
  pen.globalAlpha = alpha;
}

function drawLabel(pen, object, view) {
  const at = object.label && object.center && labelPlace(object, view);
  if (!at) return;
  const [left, top, width, height] = view.tile;
  if (at[0] < left || at[0] > left + width || at[1] < top || at[1] > top + height) return;
  pen.font = "11px system-ui, sans-serif";
  pen.textAlign = "center";
  pen.lineWidth = 3;
  pen.lineJoin = "round";
  pen.strokeStyle = ink.paper;
  const half = pen.measureText(object.label).width / 2 + 4;
  const x = clamp(at[0], left + half, Math.max(left + width - half, left + half));
  const y = Math.max(at[1], top + 14);
  pen.strokeText(object.label, x, y);
  pen.fillText(object.label, x, y);
}

// The place of the label, above the object; null if a part of it is behind the camera.
function labelPlace(object, view) {
  const { center, radius = 0 } = object;
  const points = object.corners || (object.start ? [object.start, object.stop] : [center]);
  if (![center, ...points].every((point) => view.isVisible(...point))) return null;
  const margin = object.kind === "target" ? 1.6 * MIN_TARGET : 0;
  const tops = points.map((point) => {
    const [, y, scale] = view.point(...point);
    return y - Math.max(radius * scale, margin);
  });
  return [view.point(...center)[0], Math.min(...tops) - 5];
}

const DRAW = {
  sphere(pen, object, view) {
    if (!view.isVisible(...object.center)) return;
    const [x, y, scale] = view.point(...object.center);
    const radius = object.radius * scale;
    pen.beginPath();
    pen.arc(x, y, radius, 0, 2 * Math.PI);
    fillAndStroke(pen);
    // The equator shows that it is a sphere and not a disc.
    pen.globalAlpha *= 0.6;
    strokeCircle(pen, view, object.center, object.radius);
    pen.globalAlpha /= 0.6;
  },
  // The outline of a capsule: the hull of the circles at its ends.
  capsule(pen, object, view) {
    if (![object.start, object.stop].every((end) => view.isVisible(...end))) return;
    const [x1, y1, s1] = view.point(...object.start);
    const [x2, y2, s2] = view.point(...object.stop);
    const [r1, r2] = [object.radius * s1, object.radius * s2];
    const apart = Math.hypot(x2 - x1, y2 - y1);
    pen.beginPath();
    if (apart <= Math.abs(r1 - r2)) {
      const [x, y, r] = r1 > r2 ? [x1, y1, r1] : [x2, y2, r2];
      pen.arc(x, y, r, 0, 2 * Math.PI);
    } else {
      const along = Math.atan2(y2 - y1, x2 - x1);
      const lean = Math.acos((r1 - r2) / apart);
      pen.arc(x1, y1, r1, along + lean, along - lean + 2 * Math.PI);
      pen.arc(x2, y2, r2, along - lean, along + lean);
      pen.closePath();
    }
    fillAndStroke(pen);
  },
  box(pen, object, view) {
    const { corners } = object;
    if (corners.every((corner) => view.isVisible(...corner))) {
      const alpha = pen.globalAlpha;
      pen.globalAlpha = 0.1 * alpha;
      for (const face of BOX_FACES) {
        pen.beginPath();
        for (const i of face) pen.lineTo(...view.point(...corners[i]).slice(0, 2));
        pen.fill();
      }
      pen.globalAlpha = alpha;
    }
    pen.lineWidth = 1.2;
    pen.beginPath();
    for (const face of BOX_FACES) face.forEach((i, k) => view.line(corners[i], corners[face[(k + 1) % 4]]));
    pen.stroke();
  },
  // A grid on the plane near the figure; ticks point to the forbidden side.
  plane(pen, object, view) {
    const { point, normal, across, along } = object;
    const step = view.tall / 4;
    const away = normal.reduce((sum, value, i) => sum + value * (view.target[i] - point[i]), 0);
    const foot = view.target.map((value, i) => value - away * normal[i]);
    const at = (u, v, w) => foot.map((value, i) => value + step * (u * across[i] + v * along[i]) - w * normal[i]);
    const reach = 5;
    const alpha = 0.6 * pen.globalAlpha;
    pen.lineWidth = 1;
    for (let i = -reach; i <= reach; i++) {
      for (let k = -reach; k < reach; k++) {
        const far = Math.hypot(i, k + 0.5) / reach;
        if (far >= 1) continue;
        pen.globalAlpha = alpha * (1 - far * far);
        pen.beginPath();
        view.line(at(i, k, 0), at(i, k + 1, 0));
        view.line(at(k, i, 0), at(k + 1, i, 0));
        view.line(at(i, k, 0), at(i, k, 0.3 * step));
        pen.stroke();
      }
    }
  },
  target(pen, object, view, clip) {
    if (!view.isVisible(...object.center)) return;
    const [x, y, scale] = view.point(...object.center);
    const radius = Math.max(object.radius * scale, MIN_TARGET);
    pen.lineWidth = 2;
    pen.beginPath();
    pen.arc(x, y, radius, 0, 2 * Math.PI);
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      pen.moveTo(x + 0.5 * radius * dx, y + 0.5 * radius * dy);
      pen.lineTo(x + 1.6 * radius * dx, y + 1.6 * radius * dy);
    }
    pen.stroke();
    if (isActive(object) && object.joint >= 0 && object.joint < clip.nodes) {
      pen.setLineDash([4, 4]);
      pen.lineWidth = 1.5;
      pen.beginPath();
      view.line(Array.from(clip.now.subarray(3 * object.joint, 3 * object.joint + 3)), object.center);
      pen.stroke();
      pen.setLineDash([]);
    }
  },
  // Another character: its bones as grey lines.
  figure(pen, object, view) {
    const { clip } = object;
    const moved = Math.round((state.frame * first.dt - object.delay) / clip.dt);
    pose(clip, clamp(moved, 0, clip.frames - 1), clip.now);
    const at = (node) => Array.from(clip.now.subarray(3 * node, 3 * node + 3));
    pen.lineCap = "round";
    clip.parents.forEach((parent, node) => {
      if (parent < 0 || !view.isVisible(...at(node)) || !view.isVisible(...at(parent))) return;
      const [from, to] = [at(parent), at(node)];
      pen.lineWidth = Math.max(1.5, 0.02 * view.tall * view.point(...to)[2] * clip.width[node]);
      pen.beginPath();
      view.line(from, to);
      pen.stroke();
    });
  },
};

function strokeCircle(pen, view, [x, y, z], radius) {
  pen.beginPath();
  for (let i = 0; i < 24; i++) {
    const [a, b] = [i, i + 1].map((k) => (2 * Math.PI * k) / 24);
    view.line([x + radius * Math.cos(a), y, z + radius * Math.sin(a)], [x + radius * Math.cos(b), y, z + radius * Math.sin(b)]);
  }
  pen.stroke();
}

// The frames in which constraints apply, as marks at the lower edge of the overview.
export function drawObjectFrames(pen, toPlace, height) {
  for (const { frames, kind } of scene.objects) {
    if (!frames) continue;
    const [a, b] = frames.map(toPlace);
    pen.fillStyle = kind === "target" ? ink.accent : ink.obstacle;
    pen.fillRect(a - 1, height - 6, Math.max(b - a, 0) + 2, 4);
  }
}
