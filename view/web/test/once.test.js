import assert from "node:assert/strict";
import test from "node:test";

import { REST_MS, oneAtATime } from "../src/once.js";

const button = () => ({ setAttribute(name, value) { this[name] = value; } });

// `answer` and `fail` end the command that is on its way.
function pressed(t) {
  t.mock.timers.enable({ apis: ["setTimeout"] });
  const [buttons, sent, way] = [[button(), button()], [], {}];
  const press = oneAtATime(buttons, (name) => {
    sent.push(name);
    return new Promise((resolve, reject) => { Object.assign(way, { answer: resolve, fail: reject }); });
  });
  return { buttons, sent, way, press, resting: () => buttons.every((one) => one["aria-disabled"] === "true") };
}

test("a double click is one command, and so is one that comes with the answer", async (t) => {
  const { sent, way, press, resting } = pressed(t);
  const first = press("tare");
  press("tare");
  press("pose-skip");
  assert.deepEqual(sent, ["tare"]);
  assert.ok(resting());
  way.answer();
  await first;
  t.mock.timers.tick(REST_MS - 1);
  press("tare");
  assert.deepEqual(sent, ["tare"]);
  assert.ok(resting());
  t.mock.timers.tick(1);
  assert.ok(!resting());
  press("identify-start");
  assert.deepEqual(sent, ["tare", "identify-start"]);
});

test("buttons work again after a command that failed", async (t) => {
  const { way, press, resting } = pressed(t);
  const first = press("tare");
  way.fail(new Error("no connection"));
  await assert.rejects(first);
  t.mock.timers.tick(REST_MS);
  assert.ok(!resting());
});

test("they are never taken out of the keyboard's way", async (t) => {
  const { buttons, way, press } = pressed(t);
  const first = press("tare");
  assert.ok(buttons.every((one) => one.disabled === undefined));
  way.answer();
  await first;
});
