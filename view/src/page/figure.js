// The stick figure: the worker in blue, the pose to take as a grey ghost, the joints coloured by their level.
import { FEET, HANDS, HEAD, JOINT, LEVEL_RADIUS, LEVEL_WORD, PARENT, TOES, add, colour, prepared, sub, tip } from "./body.js";

const DISTANCE_M = 5.5;
const SHOWN_HEIGHT_M = 2.45;
const SHOWN_WIDTH_M = 2.3;
const DEGREE = Math.PI / 180;

export class Figure {
  constructor(canvas) {
    this.canvas = canvas;
    this.azimuth = 30;
    this.elevation = 12;
    this.onturn = () => {};
    let dragged = null;
    canvas.addEventListener("pointerdown", (event) => {
      dragged = [event.clientX, event.clientY];
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!dragged) return;
      this.turn((dragged[0] - event.clientX) * 0.4, (event.clientY - dragged[1]) * 0.3);
      dragged = [event.clientX, event.clientY];
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { dragged = null; });
    canvas.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: [-6, 0], ArrowRight: [6, 0], ArrowUp: [0, 4], ArrowDown: [0, -4] }[event.key];
      if (!step) return;
      event.preventDefault();
      this.turn(...step);
    });
  }

  turn(azimuth, elevation) {
    this.azimuth = (this.azimuth + azimuth + 360) % 360;
    this.elevation = Math.min(80, Math.max(-5, this.elevation + elevation));
    this.onturn();
  }

  // `frame` is null while there is nothing to show.
  draw(frame) {
    const { context, width, height } = prepared(this.canvas);
    const origins = frame?.segment_origin_m;
    // The ground stands still while the worker moves: the view is centred on the feet, or on the last ones known.
    if (origins) {
      const feet = FEET.flat().map((segment) => origins[segment]);
      const middle = [0, 1].map((axis) => feet.reduce((sum, foot) => sum + foot[axis], 0) / feet.length);
      const floor = Math.min(...feet.map((foot) => foot[2])) - 0.02;
      const jumped = !this.centre || Math.hypot(middle[0] - this.centre[0], middle[1] - this.centre[1]) > 0.5;
      this.centre = jumped ? [...middle, floor] : add(this.centre, sub([...middle, floor], this.centre), 0.05);
    }
    const pen = new Pen(context, this.camera(width, height));
    this.drawFloor(pen, frame?.plate_corners_m);
    if (frame?.suggested) drawGhost(context, pen, frame.suggested.segment_origin_m);
    if (origins) {
      drawShadow(pen, origins, this.centre[2]);
      drawBody(pen, origins, colour("you"));
      drawJoints(pen, origins, frame);
    } else {
      context.font = "17px system-ui, 'DejaVu Sans', sans-serif";
      context.fillStyle = colour("soft");
      context.textAlign = "center";
      context.fillText("No picture of you at the moment", width / 2, height * 0.4);
      context.textAlign = "start";
    }
  }

  camera(width, height) {
    const [az, el] = [this.azimuth * DEGREE, this.elevation * DEGREE];
    const towards = [Math.cos(az) * Math.cos(el), Math.sin(az) * Math.cos(el), Math.sin(el)];
    const right = [-Math.sin(az), Math.cos(az), 0];
    const up = [-Math.cos(az) * Math.sin(el), -Math.sin(az) * Math.sin(el), Math.cos(el)];
    const target = add(this.centre ?? [0, 0, 0], [0, 0, 0.98]);
    const scale = Math.min(height / SHOWN_HEIGHT_M, width / SHOWN_WIDTH_M);
    const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    return (point) => {
      const d = sub(point, target);
      const depth = DISTANCE_M / Math.max(0.5, DISTANCE_M - dot(d, towards));
      return [width / 2 + dot(d, right) * scale * depth, height * 0.49 - dot(d, up) * scale * depth, scale * depth];
    };
  }

  drawFloor(pen, plate) {
    const [x, y, z] = this.centre ?? [0, 0, 0];
    const [x0, y0] = [Math.round(x * 4) / 4, Math.round(y * 4) / 4];
    for (let k = -5; k <= 5; k += 1) {
      const at = k * 0.25;
      pen.line([[x0 + at, y0 - 1.25, z], [x0 + at, y0 + 1.25, z]], colour("grid"), 0, 1);
      pen.line([[x0 - 1.25, y0 + at, z], [x0 + 1.25, y0 + at, z]], colour("grid"), 0, 1);
    }
    if (plate) pen.area(plate.map((corner) => [...corner, z]), colour("grid"), colour("none"));
  }
}

// Draws in metres of the world.
class Pen {
  constructor(context, project) {
    this.context = context;
    this.project = project;
  }

  // Thickness in metres, never thinner than `least` pixels.
  line(points, style, thickness, least = 2) {
    const { context } = this;
    const seen = points.map(this.project);
    context.beginPath();
    for (const [x, y] of seen) context.lineTo(x, y);
    context.strokeStyle = style;
    context.lineWidth = Math.max(least, thickness * seen[0][2]);
    context.lineCap = context.lineJoin = "round";
    context.stroke();
  }

  disc(point, radius, fill, edge) {
    const { context } = this;
    const [x, y, scale] = this.project(point);
    context.beginPath();
    context.arc(x, y, radius * scale, 0, 2 * Math.PI);
    context.fillStyle = fill;
    context.fill();
    if (edge) {
      context.strokeStyle = edge;
      context.lineWidth = 2;
      context.stroke();
    }
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

  // A label beside a point, kept inside the canvas.
  label(point, text, edge) {
    const { context } = this;
    const [x, y, scale] = this.project(point);
    context.font = "600 15px system-ui, 'DejaVu Sans', sans-serif";
    const wide = context.measureText(text).width + 18;
    const room = context.canvas.getBoundingClientRect().width;
    let left = x + 0.09 * scale;
    if (left + wide > room - 8) left = Math.max(8, x - 0.09 * scale - wide);
    context.beginPath();
    context.roundRect(left, y - 15, wide, 30, 8);
    context.fillStyle = colour("card");
    context.fill();
    context.strokeStyle = edge;
    context.lineWidth = 2;
    context.stroke();
    context.fillStyle = colour("ink");
    context.textBaseline = "middle";
    context.fillText(text, left + 9, y + 1);
  }
}

const thickness = (segment) => (segment < 5 ? 0.075 : segment < 7 ? 0.05 : segment < 15 ? 0.05 : 0.062);

function drawBody(pen, origins, style) {
  for (let segment = 1; segment < PARENT.length; segment += 1) {
    pen.line([origins[PARENT[segment]], origins[segment]], style, thickness(segment));
  }
  for (const hand of HANDS) pen.line([origins[hand], tip(origins, hand, 0.10)], style, 0.045);
  for (const toe of TOES) pen.line([origins[toe], tip(origins, toe, 0.06)], style, 0.05);
  pen.disc(tip(origins, HEAD, 0.10), 0.105, style);
}

// Drawn solid on a canvas of its own and laid over as one: overlapping limbs would show twice.
function drawGhost(context, pen, origins) {
  const { canvas } = context;
  const layer = new OffscreenCanvas(canvas.width, canvas.height);
  const above = layer.getContext("2d");
  above.setTransform(context.getTransform());
  drawBody(new Pen(above, pen.project), origins, colour("ghost"));
  context.save();
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.globalAlpha = Number(colour("ghost-alpha"));
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
  const joints = frame.state.joints ?? {};
  // Nearer joints are drawn later, over those behind them.
  const order = JOINT.map((name, index) => ({ name, at: origins[index + 1] }))
    .sort((a, b) => pen.project(a.at)[2] - pen.project(b.at)[2]);
  for (const { name, at } of order) {
    const level = joints[name]?.level ?? "none";
    pen.disc(at, LEVEL_RADIUS[level] ?? LEVEL_RADIUS.none, colour(level), colour("card"));
  }
  const worst = frame.worst;
  if (worst && !["none", "green"].includes(worst.level)) {
    pen.label(origins[JOINT.indexOf(worst.joint) + 1], `${worst.text}: ${LEVEL_WORD[worst.level] ?? worst.level}`, colour(worst.level));
  }
}
