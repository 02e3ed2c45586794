// Ring that fills while the worker keeps a pose. The daemon detects a static pose (`static_pose`: 20 suit samples without
// motion); until then the ring shows the time since the last motion of a joint and is never full.
import { norm, sub } from "./body.js";

const MOTION_M = 0.03;
const FILL_MS = 900;
const DONE_SHOWN_MS = 1500;

export class Hold {
  constructor() {
    this.reset();
    this.doneAt = -Infinity;
    this.poses = null;
  }

  reset() {
    this.reference = null;
    this.since = 0;
  }

  // State at `now` (ms): filled share of the ring in [0, 1], and whether a pose was just recorded.
  update(now, { origins, reached, isStatic, poses }) {
    if (this.poses !== null && poses === this.poses + 1) this.doneAt = now;
    this.poses = poses;
    const done = now - this.doneAt < DONE_SHOWN_MS;
    if (!origins || !reached) {
      this.reset();
      return { share: 0, done };
    }
    const moved = !this.reference || origins.some((origin, i) => norm(sub(origin, this.reference[i])) > MOTION_M);
    if (moved) [this.reference, this.since] = [origins, now];
    return { share: isStatic ? 1 : Math.min(0.95, (now - this.since) / FILL_MS), done };
  }
}
