// Centre of the view: low-pass filtered middle of the feet, so that the ground is steady while the worker moves. Without data
// the last centre is kept.
import { FEET, add, sub } from "./body.js";

const JUMP_M = 0.5;
const SMOOTHING = 0.03;

export class ViewCentre {
  // Middle of the feet on the floor, m.
  update(origins) {
    if (origins) {
      const feet = FEET.flat().map((segment) => origins[segment]);
      const middle = [0, 1].map((axis) => feet.reduce((sum, foot) => sum + foot[axis], 0) / feet.length);
      const now = [...middle, Math.min(...feet.map((foot) => foot[2])) - 0.02];
      const jumped = !this.centre || Math.hypot(now[0] - this.centre[0], now[1] - this.centre[1]) > JUMP_M;
      this.centre = jumped ? now : add(this.centre, sub(now, this.centre), SMOOTHING);
    }
    return this.centre ?? [0, 0, 0];
  }
}
