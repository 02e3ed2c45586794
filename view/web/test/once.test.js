import assert from "node:assert/strict";
import test from "node:test";

import { COOLDOWN_MS, oneAtATime } from "../src/once.js";

const button = () => ({ setAttribute(name, value) { this[name] = value; } });

// `pending.succeed` and `pending.fail` end the command in progress.
function setUp(t) {
  t.mock.timers.enable({ apis: ["setTimeout"] });
  const [buttons, sent, pending] = [[button(), button()], [], {}];
  const press = oneAtATime(buttons, (name) => {
    sent.push(name);
    return new Promise((resolve, reject) => { Object.assign(pending, { succeed: resolve, fail: reject }); });
  });
  return { buttons, sent, pending, press, inactive: () => buttons.every((one) => one["aria-disabled"] === "true") };
}

test("a double click sends one command, also if the second click comes after the response", async (t) => {
  const { sent, pending, press, inactive } = setUp(t);
  const first = press("tare");
  press("tare");
  press("pose-skip");
  assert.deepEqual(sent, ["tare"]);
  assert.ok(inactive());
  pending.succeed();
  await first;
  t.mock.timers.tick(COOLDOWN_MS - 1);
  press("tare");
  assert.deepEqual(sent, ["tare"]);
  assert.ok(inactive());
  t.mock.timers.tick(1);
  assert.ok(!inactive());
  press("identify-start");
  assert.deepEqual(sent, ["tare", "identify-start"]);
});

test("buttons work again after a command that failed", async (t) => {
  const { pending, press, inactive } = setUp(t);
  const first = press("tare");
  pending.fail(new Error("no connection"));
  await assert.rejects(first);
  t.mock.timers.tick(COOLDOWN_MS);
  assert.ok(!inactive());
});

test("buttons stay focusable during a command", async (t) => {
  const { buttons, pending, press } = setUp(t);
  const first = press("tare");
  assert.ok(buttons.every((one) => one.disabled === undefined));
  pending.succeed();
  await first;
});
