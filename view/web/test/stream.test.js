import assert from "node:assert/strict";
import test from "node:test";

import { FRAMES_LOST_AFTER_MS, Stream } from "../src/stream.js";

// Test double of the browser's `EventSource`; `made` lists all instances.
class FakeEventSource {
  static CLOSED = 2;
  static made = [];

  constructor() {
    this.readyState = 1;
    this.listeners = {};
    FakeEventSource.made.push(this);
  }

  addEventListener(name, listener) { this.listeners[name] = listener; }
  close() { this.readyState = FakeEventSource.CLOSED; }
  emit(name, data) { this.listeners[name]({ data }); }
}

// A stream, and `after(ms)`, which advances the mocked time in steps of 100 ms, the period of the stream's timer.
function setUp(t, ...limit) {
  let now = 0;
  FakeEventSource.made = [];
  globalThis.EventSource = FakeEventSource;
  const page = new EventTarget();
  globalThis.addEventListener = page.addEventListener.bind(page);
  t.mock.timers.enable({ apis: ["setInterval"] });
  t.mock.method(performance, "now", () => now);
  const stream = new Stream("/events", ["frame"], () => {}, ...limit);
  const after = (ms) => {
    for (const end = now + ms; now < end;) {
      now += 100;
      t.mock.timers.tick(100);
    }
  };
  // The page is busy: no timer runs.
  const busy = (ms) => { now += ms; };
  return { stream, after, busy, page };
}

test("a page that is left closes its connection, and connects again when it returns", (t) => {
  const { stream, page } = setUp(t);
  const { made } = FakeEventSource;
  made[0].emit("frame", "{}");
  page.dispatchEvent(new Event("pagehide"));
  assert.equal(made[0].readyState, FakeEventSource.CLOSED);
  page.dispatchEvent(Object.assign(new Event("pageshow"), { persisted: false }));
  assert.equal(made.length, 1);
  page.dispatchEvent(Object.assign(new Event("pageshow"), { persisted: true }));
  assert.deepEqual([made.length, stream.connection, stream.newest()], [2, "waiting", null]);
});

test("events keep the connection", (t) => {
  const { stream, after } = setUp(t);
  for (let i = 0; i < 20; i += 1) {
    FakeEventSource.made[0].emit("silent");
    after(2000);
  }
  assert.equal(FakeEventSource.made.length, 1);
  assert.equal(stream.connection, "silent");
});

test("an open connection without events is lost and opened again", (t) => {
  const { stream, after } = setUp(t);
  FakeEventSource.made[0].emit("frame", "{}");
  after(3000);
  assert.equal(stream.connection, "lost");
  assert.equal(stream.newest(), null, "stale data are discarded");
  assert.equal(FakeEventSource.made.length, 1, "no reconnection yet");
  after(3000);
  assert.equal(FakeEventSource.made.length, 2);
  assert.equal(FakeEventSource.made[0].readyState, FakeEventSource.CLOSED);
  FakeEventSource.made[1].emit("frame", '{"a":1}');
  assert.equal(stream.connection, "live");
  assert.deepEqual(stream.newest(), { a: 1 });
});

test("frames are lost after a second; without data an event a second keeps the connection", (t) => {
  const { stream, after } = setUp(t, FRAMES_LOST_AFTER_MS);
  FakeEventSource.made[0].emit("frame", "{}");
  after(1000);
  assert.equal(stream.connection, "live");
  after(100);
  assert.deepEqual([stream.connection, stream.newest()], ["lost", null]);
  FakeEventSource.made[0].emit("silent");
  after(2500);
  assert.equal(stream.connection, "silent");
  after(100);
  assert.equal(stream.connection, "lost");
});

test("after a pause of the page one check is skipped, so that events are processed first", (t) => {
  const { stream, after, busy } = setUp(t, FRAMES_LOST_AFTER_MS);
  FakeEventSource.made[0].emit("frame", "{}");
  for (let i = 0; i < 2; i += 1) {
    busy(2000);
    after(100);
    assert.equal(stream.connection, "live");
    FakeEventSource.made[0].emit("frame", "{}");
    after(100);
    assert.equal(stream.connection, "live");
  }
  busy(2000);
  after(200);
  assert.equal(stream.connection, "lost");
});

test("a demonstration that has ended leaves its results, and is not connected to again", (t) => {
  const { stream, after, page } = setUp(t);
  const { made } = FakeEventSource;
  made[0].emit("frame", "{}");
  made[0].emit("ended", '{"results":[1]}');
  assert.deepEqual([stream.connection, stream.newest(), stream.results], ["ended", null, [1]]);
  assert.equal(made[0].readyState, FakeEventSource.CLOSED);
  after(60_000);
  page.dispatchEvent(Object.assign(new Event("pageshow"), { persisted: true }));
  assert.deepEqual([made.length, stream.connection], [1, "ended"]);
});

test("every attempt has the same timeout", (t) => {
  const { after } = setUp(t);
  after(60_000);
  // Each attempt times out at the first check after 5 s.
  assert.equal(FakeEventSource.made.length, 1 + Math.floor(60 / 5.1));
});

test("a connection closed by the browser is opened again after a second", (t) => {
  const { after } = setUp(t);
  FakeEventSource.made[0].emit("error");
  after(1000);
  assert.equal(FakeEventSource.made.length, 1, "the browser reconnects by itself");
  FakeEventSource.made[0].readyState = FakeEventSource.CLOSED;
  after(100);
  assert.equal(FakeEventSource.made.length, 2);
  FakeEventSource.made[1].readyState = FakeEventSource.CLOSED;
  after(1000);
  assert.equal(FakeEventSource.made.length, 2, "not at every check");
  after(100);
  assert.equal(FakeEventSource.made.length, 3);
});
