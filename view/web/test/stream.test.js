import assert from "node:assert/strict";
import test from "node:test";

import { Stream } from "../src/stream.js";

// A browser's connection, as the page sees it; `made` holds all that were asked for.
class Connection {
  static CLOSED = 2;
  static made = [];

  constructor() {
    this.readyState = 1;
    this.heard = {};
    Connection.made.push(this);
  }

  addEventListener(name, heard) { this.heard[name] = heard; }
  close() { this.readyState = Connection.CLOSED; }
  tell(name, data) { this.heard[name]({ data }); }
}

// A stream, and `after(ms)`, which lets time pass a second at a time, as the stream looks at its clock.
function begun(t) {
  let now = 0;
  Connection.made = [];
  globalThis.EventSource = Connection;
  t.mock.timers.enable({ apis: ["setInterval"] });
  t.mock.method(performance, "now", () => now);
  const stream = new Stream("/events", ["frame"], () => {});
  const after = (ms) => {
    for (const end = now + ms; now < end;) {
      now += 1000;
      t.mock.timers.tick(1000);
    }
  };
  return { stream, after };
}

test("who hears something stays connected", (t) => {
  const { stream, after } = begun(t);
  for (let i = 0; i < 20; i += 1) {
    Connection.made[0].tell("silent");
    after(2000);
  }
  assert.equal(Connection.made.length, 1);
  assert.equal(stream.connection, "silent");
});

test("a connection on which nothing is heard is lost, and asked for anew though it is open", (t) => {
  const { stream, after } = begun(t);
  Connection.made[0].tell("frame", "{}");
  after(3000);
  assert.equal(stream.connection, "lost");
  assert.equal(stream.newest(), null, "what was told may no longer be true");
  assert.equal(Connection.made.length, 1, "a service may be late");
  after(3000);
  assert.equal(Connection.made.length, 2);
  assert.equal(Connection.made[0].readyState, Connection.CLOSED);
  Connection.made[1].tell("frame", '{"a":1}');
  assert.equal(stream.connection, "live");
  assert.deepEqual(stream.newest(), { a: 1 });
});

test("every attempt has as long as the first", (t) => {
  const { after } = begun(t);
  after(60_000);
  assert.equal(Connection.made.length, 1 + 60 / 6);
});

test("what the browser gave up is asked for after a second", (t) => {
  const { after } = begun(t);
  Connection.made[0].tell("error");
  after(1000);
  assert.equal(Connection.made.length, 1, "the browser tries by itself");
  Connection.made[0].readyState = Connection.CLOSED;
  after(1000);
  assert.equal(Connection.made.length, 2);
});
