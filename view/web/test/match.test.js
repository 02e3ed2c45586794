import assert from "node:assert/strict";
import test from "node:test";

import { PARENT } from "../src/body.js";
import { LIMBS, isPlaced, limbsOff, share, worstLimb } from "../src/match.js";

// Every bone straight up, 10 cm long.
const body = () => {
  const origins = [[0, 0, 1]];
  for (let i = 1; i < PARENT.length; i += 1) origins.push(origins[PARENT[i]].map((v, axis) => v + (axis === 2 ? 0.1 : 0)));
  return origins;
};

test("a limb is off by the angle of its bone, wherever and however large the worker is", () => {
  const [worker, asked] = [body(), body().map((origin) => origin.map((v) => 3 + 2 * v))];
  assert.ok(Object.values(limbsOff(worker, asked)).every((rad) => rad < 1e-6));
  const elbow = LIMBS.right_arm[1];
  worker[elbow] = worker[PARENT[elbow]].map((v, axis) => v + (axis === 0 ? 0.1 : 0));
  const off = limbsOff(worker, asked);
  assert.ok(Math.abs(off.right_arm - Math.PI / 2) < 1e-6);
  assert.equal(off.left_arm, 0);
  assert.equal(worstLimb(off), "right_arm");
});

test("a segment is placed with its limb, and never while nothing is asked for", () => {
  const off = { ...limbsOff(body(), body()), right_arm: 0.5 };
  assert.ok(isPlaced(LIMBS.left_arm[0], off, 0.2));
  assert.ok(!isPlaced(LIMBS.right_arm[0], off, 0.2));
  assert.ok(!isPlaced(LIMBS.left_arm[0], null, 0.2));
  assert.ok(!isPlaced(0, off, 0.2));
});

test("in the pose there is no limb to look at", () => {
  assert.equal(worstLimb(limbsOff(body(), body())), null);
});

test("the match is whole exactly where the service calls the pose reached", () => {
  assert.equal(share(0.2, 0.2), 1);
  assert.ok(share(0.21, 0.2) < 1);
  assert.ok(share(1.0, 0.2) < share(0.5, 0.2));
  assert.equal(share(3, 0.2), 0);
});
