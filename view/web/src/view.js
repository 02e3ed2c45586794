// View of the scene in perspective: turned by dragging and by the arrow keys, framed around the worker's feet and the highest
// point. Both figures and the marks on them are drawn with it.
import { FEET, add, headCentre, standingHeight, sub, tip, HANDS } from "./body.js";

const DISTANCE_M = 5.5;
const KEYS = { ArrowLeft: [-6, 0], ArrowRight: [6, 0], ArrowUp: [0, 4], ArrowDown: [0, -4] };
const ELEVATION = 10;
// Below the floor, and above head or hands.
const MARGIN_M = 0.16;
// Room for arms stretched out to both sides.
const WIDTH_M = 2.0;
// Larger steps of the feet move the view at once.
const JUMP_M = 0.5;
const SMOOTHING = 0.03;
const ZOOM_SMOOTHING = 0.08;

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

export class View {
  // `canvas` takes the pointer and the keys; `changed` is called after each turn.
  constructor(canvas, changed) {
    this.changed = changed;
    this.centre = [0, 0, 0];
    this.heightM = 2.1;
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
      if (!KEYS[event.key]) return;
      event.preventDefault();
      this.turn(...KEYS[event.key]);
    });
    [this.azimuth, this.elevation] = [0, ELEVATION];
  }

  // Azimuth 0 is in front of the worker. A mirrored view shows the worker's left side on the left, as a mirror does.
  look(azimuth, mirrored) {
    [this.azimuth, this.elevation, this.mirrored, this.turned] = [azimuth, ELEVATION, mirrored, false];
    this.changed();
  }

  turn(azimuth, elevation) {
    this.azimuth = (this.azimuth + (this.mirrored ? -azimuth : azimuth) + 360) % 360;
    this.elevation = Math.min(80, Math.max(-5, this.elevation + elevation));
    this.turned = true;
    this.changed();
  }

  // Frames the worker and the requested pose on a canvas of this size, CSS pixels. Without data the last framing is kept.
  update(frame, width, height) {
    [this.width, this.height] = [width, height];
    const origins = frame?.segment_origin_m;
    if (origins) {
      const feet = FEET.flat().map((segment) => origins[segment]);
      const middle = [0, 1].map((axis) => feet.reduce((sum, foot) => sum + foot[axis], 0) / feet.length);
      const now = [...middle, Math.min(...feet.map((foot) => foot[2])) - 0.02];
      const jumped = !this.framed || Math.hypot(now[0] - this.centre[0], now[1] - this.centre[1]) > JUMP_M;
      this.centre = jumped ? now : add(this.centre, sub(now, this.centre), SMOOTHING);
      this.standingM = standingHeight(origins);
      const tops = [origins, frame.suggested?.segment_origin_m].filter(Boolean)
        .flatMap((body) => [headCentre(body)[2] + 0.12, ...HANDS.map((hand) => tip(body, hand, 0.14)[2])]);
      const highest = Math.max(this.standingM, ...tops.map((top) => top - this.centre[2])) + 2 * MARGIN_M;
      this.heightM = jumped ? highest : this.heightM + ZOOM_SMOOTHING * (highest - this.heightM);
      this.framed = true;
    }
    const [az, el] = [this.azimuth, this.elevation].map((degrees) => degrees * Math.PI / 180);
    this.towards = [Math.cos(az) * Math.cos(el), Math.sin(az) * Math.cos(el), Math.sin(el)];
    this.right = [-Math.sin(az), Math.cos(az), 0];
    this.up = [-Math.cos(az) * Math.sin(el), -Math.sin(az) * Math.sin(el), Math.cos(el)];
    this.shownM = Math.max(this.heightM, WIDTH_M * height / Math.max(width, 1));
    this.target = add(this.centre, [0, 0, this.heightM / 2 - MARGIN_M]);
    this.eye = add(this.target, this.towards, DISTANCE_M);
    this.fov = 2 * Math.atan(this.shownM / 2 / DISTANCE_M) * 180 / Math.PI;
  }

  // Canvas position of a world point, CSS pixels, and pixels per metre there.
  project = (point) => {
    const d = sub(point, this.target);
    const scale = this.height / this.shownM * DISTANCE_M / Math.max(0.5, DISTANCE_M - dot(d, this.towards));
    const x = dot(d, this.right) * scale;
    return [this.width / 2 + (this.mirrored ? -x : x), this.height / 2 - dot(d, this.up) * scale, scale];
  };

  // Height on the canvas of the worker when standing, CSS pixels.
  get figurePx() {
    return this.framed ? this.standingM * this.height / this.shownM : 0;
  }
}
