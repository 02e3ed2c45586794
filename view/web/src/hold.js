// The ring that fills while the worker holds still. Whether a pose counts is the service's to say (`static_pose`: 20 samples
// of the suit without motion); until it says so, the ring shows for how long no joint has moved, and is never full.
import { norm, sub } from "./body.js";

const MOVED_M = 0.03;
const LASTS_MS = 900;
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

  // What to show at `now` (ms): share of the ring in [0, 1], and whether a pose was just taken.
  see(now, { origins, reached, still, poses }) {
    if (this.poses !== null && poses === this.poses + 1) this.doneAt = now;
    this.poses = poses;
    const done = now - this.doneAt < DONE_SHOWN_MS;
    if (!origins || !reached) {
      this.reset();
      return { share: 0, done };
    }
    const moved = !this.reference || origins.some((origin, i) => norm(sub(origin, this.reference[i])) > MOVED_M);
    if (moved) [this.reference, this.since] = [origins, now];
    return { share: still ? 1 : Math.min(0.95, (now - this.since) / LASTS_MS), done };
  }
}
