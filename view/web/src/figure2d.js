// 2D figure, for browsers without WebGL.
import { FEET, JOINT, LEVELS, add, bones, colour, headCentre, levelOf, prepared, sub } from "./body.js";
import { isPlaced } from "./match.js";
import { Orbit } from "./orbit.js";
import { ViewCentre } from "./view_centre.js";

const DISTANCE_M = 5.5;
// Includes raised hands, enlarged by perspective, and a margin below the floor.
const SHOWN_HEIGHT_M = 2.65;
const SHOWN_WIDTH_M = 2.3;

export class Figure2d extends Orbit {
  constructor(canvas) {
    super(canvas);
    this.canvas = canvas;
    this.viewCentre = new ViewCentre();
  }

  // `frame` is null while no data are available. `deviations`: angle of each limb from the suggested pose, rad.
  draw(frame, deviations, reachedRad) {
    const { context, width, height } = prepared(this.canvas);
    const origins = frame?.segment_origin_m;
    const centre = this.viewCentre.update(origins);
    this.project = this.camera(width, height, centre);
    const pen = new Pen(context, this.project);
    drawFloor(pen, centre, frame?.plate_corners_m);
    if (frame?.suggested) drawGhost(context, pen, frame.suggested.segment_origin_m, (segment) => colour(isPlaced(segment, deviations, reachedRad) ? "green" : "ghost"));
    if (origins) {
      drawShadow(pen, origins, centre[2]);
      drawBody(pen, origins, () => colour("you"));
      if (frame.state.phase === "monitoring") drawJoints(pen, origins, frame);
    }
    this.canvas.dataset.drawn = [origins && "worker", frame?.suggested && "suggested"].filter(Boolean).join(" ");
  }

  camera(width, height, centre) {
    const { towards, right, up } = this.axes();
    const target = add(centre, [0, 0, 1.06]);
    const scale = Math.min(height / SHOWN_HEIGHT_M, width / SHOWN_WIDTH_M);
    const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    return (point) => {
      const d = sub(point, target);
      const depth = DISTANCE_M / Math.max(0.5, DISTANCE_M - dot(d, towards));
      return [width / 2 + dot(d, right) * scale * depth, height * 0.49 - dot(d, up) * scale * depth, scale * depth];
    };
  }
}

// Draws in world coordinates, m.
class Pen {
  constructor(context, project) {
    this.context = context;
    this.project = project;
  }

  // `thickness` in metres; at least `least` pixels.
  line(points, style, thickness, least = 2) {
    const { context } = this;
    const projected = points.map(this.project);
    context.beginPath();
    for (const [x, y] of projected) context.lineTo(x, y);
    context.strokeStyle = style;
    context.lineWidth = Math.max(least, thickness * projected[0][2]);
    context.lineCap = context.lineJoin = "round";
    context.stroke();
  }

  disc(point, radius, fill, edge, sign = "") {
    const { context } = this;
    const [x, y, scale] = this.project(point);
    context.beginPath();
    context.arc(x, y, radius * scale, 0, 2 * Math.PI);
    context.fillStyle = fill;
    context.fill();
    if (!edge) return;
    context.strokeStyle = edge;
    context.lineWidth = 2;
    context.stroke();
    context.fillStyle = edge;
    context.font = `700 ${Math.round(1.4 * radius * scale)}px system-ui, 'DejaVu Sans', sans-serif`;
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.fillText(sign, x, y + 1);
  }

  area(points, fill, edge) {
    const { context } = this;
    context.beginPath();
    for (const [x, y] of points.map(this.project)) context.lineTo(x, y);
    context.closePath();
    context.globalAlpha = 0.6;
    context.fillStyle = fill;
    context.fill();
    context.globalAlpha = 1;
    context.strokeStyle = edge;
    context.lineWidth = 1.5;
    context.stroke();
  }
}

function drawFloor(pen, [x, y, z], plate) {
  const [x0, y0] = [Math.round(x * 4) / 4, Math.round(y * 4) / 4];
  for (let k = -5; k <= 5; k += 1) {
    const at = k * 0.25;
    pen.line([[x0 + at, y0 - 1.25, z], [x0 + at, y0 + 1.25, z]], colour("grid"), 0, 1);
    pen.line([[x0 - 1.25, y0 + at, z], [x0 + 1.25, y0 + at, z]], colour("grid"), 0, 1);
  }
  if (plate) pen.area(plate.map((corner) => [...corner, z]), colour("grid"), colour("none"));
}

function drawBody(pen, origins, styleOf, thickness = 1) {
  for (const { from, to, radius, segment } of bones(origins)) pen.line([from, to], styleOf(segment), 2 * radius * thickness);
  pen.disc(headCentre(origins), 0.105 * thickness, styleOf());
}

// Drawn opaque on a separate canvas, then blended once: otherwise overlapping limbs would be darker.
function drawGhost(context, pen, origins, styleOf) {
  const { canvas } = context;
  const layer = new OffscreenCanvas(canvas.width, canvas.height);
  const above = layer.getContext("2d");
  above.setTransform(context.getTransform());
  drawBody(new Pen(above, pen.project), origins, styleOf, 1.1);
  context.save();
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.globalAlpha = 0.62;
  context.drawImage(layer, 0, 0);
  context.restore();
}

function drawShadow(pen, origins, floor) {
  pen.context.globalAlpha = 0.07;
  for (const [heel, toe] of FEET) {
    const flat = [heel, toe].map((segment) => [...origins[segment].slice(0, 2), floor]);
    pen.line(flat, colour("ink"), 0.13);
  }
  pen.context.globalAlpha = 1;
}

function drawJoints(pen, origins, frame) {
  // Painter's algorithm: far joints first.
  const order = JOINT.map((name, index) => ({ name, at: origins[index + 1] }))
    .sort((a, b) => pen.project(a.at)[2] - pen.project(b.at)[2]);
  for (const { name, at } of order) {
    const level = levelOf(frame, name);
    const { radius, sign } = LEVELS[level] ?? LEVELS.none;
    pen.disc(at, radius, colour(level), colour("card"), sign);
  }
}
