// Where the worker stands. The ground stands still while the worker moves: the view is centred on the feet, or on the last
// ones known, and follows slowly.
import { FEET, add, sub } from "./body.js";

const JUMPED_M = 0.5;
const FOLLOWS = 0.03;

export class Standing {
  // Middle of the feet on the floor, m.
  see(origins) {
    if (origins) {
      const feet = FEET.flat().map((segment) => origins[segment]);
      const middle = [0, 1].map((axis) => feet.reduce((sum, foot) => sum + foot[axis], 0) / feet.length);
      const now = [...middle, Math.min(...feet.map((foot) => foot[2])) - 0.02];
      const jumped = !this.centre || Math.hypot(now[0] - this.centre[0], now[1] - this.centre[1]) > JUMPED_M;
      this.centre = jumped ? now : add(this.centre, sub(now, this.centre), FOLLOWS);
    }
    return this.centre ?? [0, 0, 0];
  }
}
