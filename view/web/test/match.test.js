import assert from "node:assert/strict";
import test from "node:test";

import { PARENT } from "../src/body.js";
import { LIMBS, isPlaced, limbDeviations, movements, agreement, worstLimb } from "../src/match.js";

// Every bone straight up, 10 cm long.
const body = () => {
  const origins = [[0, 0, 1]];
  for (let i = 1; i < PARENT.length; i += 1) origins.push(origins[PARENT[i]].map((v, axis) => v + (axis === 2 ? 0.1 : 0)));
  return origins;
};

test("a limb's deviation is the angle of its bone, independent of position and stature", () => {
  const [worker, suggested] = [body(), body().map((origin) => origin.map((v) => 3 + 2 * v))];
  assert.ok(Object.values(limbDeviations(worker, suggested)).every((rad) => rad < 1e-6));
  const elbow = LIMBS.right_arm[1];
  worker[elbow] = worker[PARENT[elbow]].map((v, axis) => v + (axis === 0 ? 0.1 : 0));
  const deviations = limbDeviations(worker, suggested);
  assert.ok(Math.abs(deviations.right_arm - Math.PI / 2) < 1e-6);
  assert.equal(deviations.left_arm, 0);
  assert.equal(worstLimb(deviations), "right_arm");
});

test("a segment matches with its limb, and never without a suggested pose", () => {
  const deviations = { ...limbDeviations(body(), body()), right_arm: 0.5 };
  assert.ok(isPlaced(LIMBS.left_arm[0], deviations, 0.2));
  assert.ok(!isPlaced(LIMBS.right_arm[0], deviations, 0.2));
  assert.ok(!isPlaced(LIMBS.left_arm[0], null, 0.2));
  assert.ok(!isPlaced(0, deviations, 0.2));
});

test("in the pose no limb is named", () => {
  assert.equal(worstLimb(limbDeviations(body(), body())), null);
});

test("agreement is 1 exactly where the daemon accepts the pose", () => {
  assert.equal(agreement(0.2, 0.2), 1);
  assert.ok(agreement(0.21, 0.2) < 1);
  assert.ok(agreement(1.0, 0.2) < agreement(0.5, 0.2));
  assert.equal(agreement(3, 0.2), 0);
});

test("an arrow leads from each deviating limb to its place", () => {
  const [worker, suggested] = [body(), body()];
  const hand = LIMBS.right_arm[2];
  suggested[hand] = suggested[hand].map((v, axis) => v + (axis === 0 ? 0.3 : 0));
  assert.deepEqual(movements(worker, suggested, limbDeviations(worker, suggested)), [[worker[hand], suggested[hand]]]);
  assert.deepEqual(movements(worker, worker, limbDeviations(worker, worker)), []);
});
